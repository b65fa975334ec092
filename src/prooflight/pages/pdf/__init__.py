"""PDF -> plates, as a digital press rips it; MuPDF is entered in a process of its own."""
