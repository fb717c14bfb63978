"""A paper dodecahedron with a printed marker on each face, as the probe."""
