"""The console: runs of a press in a browser.

It is a process of its own, which reads the journal while `watch` writes it, and writes only its own file.
"""
