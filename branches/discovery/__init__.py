"""Finding orbits at a given energy: all of them within bounds, by an adaptive scan of the starts that says when it is settled."""
