"""`livedrive eval eyes`: eye encoder and gaze walk on rendered clips and real videos."""
