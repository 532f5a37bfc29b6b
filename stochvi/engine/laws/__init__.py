"""Laws of stops: each a class of numbers with its functions, in a file of its own."""
