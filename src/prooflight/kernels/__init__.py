"""Every compiled loop, with the shapes that it takes; nothing here knows of pages, presses or verdicts."""
