"""USB cameras without a driver: UVC over bulk transfers and vendor commands, through pyusb."""
