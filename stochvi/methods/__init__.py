"""The methods that turn a model into a response. No method imports another."""
