"""Eye pictures to eye features, gaze and lids; synthesised gaze (paper section 5.2)."""
