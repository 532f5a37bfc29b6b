"""Springs and dampers as kernels know them: one class in each file."""
