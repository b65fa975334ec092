"""Engineering of the press from the console: new versions of it, what each would have done, and which is in use."""
