"""The compiled code of the Monte Carlo: numbers and arrays in, numbers and arrays out."""
