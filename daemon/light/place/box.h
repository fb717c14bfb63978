/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A room as an upright box, and light that comes from its walls: what is seen of them from one
 * place tells what is seen of them from another one. Pure functions on plain data.
 */
#ifndef LP_LIGHT_PLACE_BOX_H
#define LP_LIGHT_PLACE_BOX_H

#define LP_BOX_ORDERS 5 /* 0 .. 4 */
#define LP_BOX_SH_COUNT (LP_BOX_ORDERS * LP_BOX_ORDERS)
/* Directions over which light is summed up: as the clients have them (docs/users/conventions.md).
 */
#define LP_BOX_RAYS 128

/* In a world whose +Y is up. Walls come in the order -x +x -y +y -z +z of the box's axes. */
struct lp_box {
	double origin_m[3]; /* a place in it, in the world */
	double wall_m[6];   /* from there to each wall */
	double yaw_rad;	    /* turns its axes about +Y into those of the world */
};

/* A box as it is seen from a place. */
struct lp_box_view {
	struct lp_box box;
	double axes[3][3]; /* the box's, in the world */
	double from_m[3];  /* world, from the box's origin; just inside */
	double left_m[6];  /* from there to each wall */
};

/* Where a ray ends. */
struct lp_box_hit {
	int wall;
	double normal[3]; /* outward, world */
	double at_m[3];	  /* world, from the box's origin */
	double cosine;	  /* of the ray against the normal, above 0 */
};

/* From `from_m` (world, from the box's origin). A place that is not in the box: from just inside.
 */
struct lp_box_view lp_box_look(const struct lp_box *box, const double from_m[3]);

/* The wall that is seen along a unit vector (world). */
struct lp_box_hit lp_box_hit(const struct lp_box_view *view, const double along[3]);

/* The distances of the walls from a place, in the order of wall_m; below 0: it is behind that
 * wall. */
void lp_box_walls_from(const struct lp_box *box, const double place_m[3], double wall_m[6]);

/* Directions all around, and the basis of spherical harmonics along each. */
struct lp_box_rays {
	double along[LP_BOX_RAYS][3], basis[LP_BOX_RAYS][LP_BOX_SH_COUNT];
};

void lp_box_fill_rays(struct lp_box_rays *rays);

/* The basis along the directions in which the box's origin sees what `from_m` sees along each ray.
 */
void lp_box_look_around(const struct lp_box_rays *rays, const struct lp_box *box,
			const double from_m[3], double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT]);

/*
 * Spherical harmonics (radiance, world) at the place for which `seen` is, by those at the box's
 * origin: docs/users/conventions.md, "Ambient light at a place". moved[l]: by those up to order l
 * alone; the others stay.
 */
void lp_box_move_sh(const struct lp_box_rays *rays, const double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT],
		    const double sh[LP_BOX_SH_COUNT], double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT]);

#endif
