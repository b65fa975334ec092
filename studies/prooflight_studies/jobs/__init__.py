"""Study of the hot folder: files of all sorts sent while the process that takes them in is killed."""
