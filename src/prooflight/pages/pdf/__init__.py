"""Ripping of PDFs to plates, as on a digital press; MuPDF runs in a process of its own."""
