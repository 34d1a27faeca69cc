"""What a study's flights say: flights in, numbers out. Pure but for `joined`, which reads the folder."""
