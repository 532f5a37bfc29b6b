"""What every calculation returns: numbers with their errors, responses, messages, files."""
