// SPDX-License-Identifier: Apache-2.0
// The body of a paper dodecahedron as a probe (docs/users/probes.md), for those who print it and glue
// the two sheets of `lightprobe net dodecahedron:30mm net.pdf` around it, cut along the faces without
// their tabs: edges of the same number meet. It is no part of the box.
//
//   openscad -D edge=30 -o dodecahedron.stl hw/cad/dodecahedron.scad

edge = 30;       // of the paper's faces, as --probe names it, in mm
paper = 0.15;    // thickness of paper and glue, per side
stick = 0;       // diameter of a bore for a stick below, so that it can be held; 0: none
stick_depth = 15;

golden = (1 + sqrt(5)) / 2;
// From the centre to a face of the paper, and how much smaller the body is.
inradius = edge * golden * golden / (2 * sqrt(3 - golden));
size = edge * golden / 2 * (inradius - paper) / inradius;
// A cube's vertices, and twelve more: two over each of its faces.
vertices = concat(
	[for (x = [-1, 1], y = [-1, 1], z = [-1, 1]) [x, y, z]],
	[for (a = [-1 / golden, 1 / golden], b = [-golden, golden]) [0, a, b]],
	[for (a = [-1 / golden, 1 / golden], b = [-golden, golden]) [a, b, 0]],
	[for (a = [-1 / golden, 1 / golden], b = [-golden, golden]) [b, 0, a]]
);
// How far the face with the normal (0, golden, 1) is turned from below.
turn = 180 - atan(golden);

// It lies on a face.
module dodecahedron() rotate([turn, 0, 0]) hull() polyhedron(size * vertices, [[for (i = [0:19]) i]]);

difference() {
	dodecahedron();
	if (stick > 0)
		translate([0, 0, paper - inradius - 1]) cylinder(d = stick, h = stick_depth + 1, $fn = 48);
}
