"""Pictures as linear light, and where the pixels of a camera look."""
