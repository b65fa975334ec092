"""The study of RIPs: what ours and Ghostscript print beside what ISO 32000 says."""
