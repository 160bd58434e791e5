"""Where the head's pose comes from: trackers on the network, the web page, recorded poses."""
