"""The running press: endless lines in, one verdict a sheet out."""
