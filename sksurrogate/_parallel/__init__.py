"""Work in other processes: joblib workers, a forked second process, and the messages between processes."""
