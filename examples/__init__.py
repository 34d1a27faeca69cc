"""Examples of programs that use the project, one per folder or script. The wheel does not contain them."""
