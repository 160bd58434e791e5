"""USB cameras without a system driver."""
