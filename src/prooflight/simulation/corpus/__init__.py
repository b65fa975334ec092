"""Page designs of any number, and the sample job."""
