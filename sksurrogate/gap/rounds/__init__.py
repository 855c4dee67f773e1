"""What is asked once more: on a corrected record, of some runs alone, under a disturbance."""
