"""Tables, plots, pages and files, made from answers alone."""
