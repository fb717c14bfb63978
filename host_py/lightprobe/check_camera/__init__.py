"""What a camera does to its pictures by itself: frames in, answers out."""
