"""From endless lines to sheets: a store of lines, edges, thumbnails, and the place in the job."""
