"""What a user writes: structures, impact laws, excitations, absorbers, scenes."""
