"""The compiled code of motions: numbers and arrays in, numbers and arrays out."""
