"""What is wrong with the record itself: readings, runs and inputs."""
