/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Places of the picture that shine by themselves: stuck and warm pixels, and light that moves with
 * the camera, as a status lamp of the box that the lens sees. They are bright spots at the same
 * place of the picture, whatever direction that place looks in.
 *
 * Per camera cell the logarithm of the odds that it is one (a sequential probability ratio test;
 * Wald 1945), of looks that have nothing to do with each other: the cell looks at what is several
 * cells away from all it has shone at before, or a hand is before the lens. A camera that holds
 * still tells nothing: what it sees may be a lamp. Nor does a spot that stays where it was
 * seen, for other cells, when the cell looks elsewhere: a lamp. How often any cell of a frame is
 * such a spot is measured in that frame. What is found is forgotten in the same way.
 *
 * A cell that is left out is filled with what its neighbours show, and marked (LP_CELL_FILLED).
 *
 * Pure computation but for lp_stuck_fit(); one thread. Plain data, zeroed is none.
 */
#ifndef LP_VISION_STUCK_STUCK_H
#define LP_VISION_STUCK_STUCK_H

#include <stdbool.h>
#include <stdint.h>

#include "light/math/rotation.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lp_camera;
struct lp_cells;

/* So many directions are remembered: more than it takes to be certain. */
#define LP_STUCK_SHOWN 6
#define LP_STUCK_UNIT 32000.0F

/* What is known of a cell that may shine by itself. */
struct lp_stuck_cell {
	/* That it showed, of full scale, in the shortest exposure in which it did; INFINITY: it has
	 * not. */
	float excess;
	float scale; /* of that frame; INFINITY: all there is is a camera file that names it */
	/* Directions in which it has shown itself, anchor frame, times LP_STUCK_UNIT; the oldest
	 * gives way. And that of its last look, in which it may not have. */
	int16_t shown[LP_STUCK_SHOWN][3], looked[3];
	uint8_t shown_count, next;
	bool looked_covered; /* since a hand has come */
	bool is_light;	     /* more than a stuck pixel would show */
};

/* A part of the picture: shares of its width and height. */
struct lp_stuck_place {
	float x0, y0, x1, y1;
};

struct lp_stuck {
	int width_px, height_px, cell_px; /* of the picture; 0: none has come */
	int columns, rows;		  /* of cells */
	bool wraps;			  /* the last column is beside the first */
	float least_cosine; /* of the angle between two looks that have nothing to do with each
			     * other */
	struct lp_rotation looked_from; /* camera to anchor, in the last look */
	float (*ray)[3];		/* per cell, camera frame; NAN: nothing is seen */
	uint8_t *is_sliver; /* per cell: it sees so little that it neither harms nor tells */
	float *log_odds;    /* per cell, that it shines by itself */
	struct lp_stuck_cell *cell;
	float *light;	  /* workspace: what each cell shows, of full scale */
	uint8_t *stands;  /* workspace: it stands out */
	bool any_covered; /* a cell may have looked_covered */
	int *list;	  /* the cells that are left out */
	float *own;	  /* what those show themselves, of full scale */
	int count;
	int told;		      /* the most that the log has told of */
	int64_t t_changed_ns;	      /* when `count` last changed */
	struct lp_stuck_place *given; /* known before the first picture came */
	int given_count;
};

/* For pictures of another size or part of the sphere: what is known of places of the picture is
 * carried over. At first that is what the camera file says. -ENOMEM. */
int lp_stuck_fit(struct lp_stuck *stuck, const struct lp_camera *camera, int width_px,
		 int height_px, int cell_px);
void lp_stuck_release(struct lp_stuck *stuck);

/* Take over what another one has learned, of pictures of any size; before the first lp_stuck_fit()
 * it waits for that. -ENOMEM. */
int lp_stuck_inherit(struct lp_stuck *stuck, const struct lp_stuck *from);

/* Fill the cells that are left out. */
void lp_stuck_fill(struct lp_stuck *stuck, struct lp_cells *cells);

static inline bool lp_stuck_leaves_out(const struct lp_stuck *stuck, int cell)
{
	return stuck->count && stuck->log_odds[cell] > 0.0F;
}

/* A frame that has been filled, and how the camera was turned. */
struct lp_stuck_look {
	const struct lp_cells *cells;
	const struct lp_rotation *to_anchor;
	bool turns; /* else only what is covered tells anything */
	/* Whether a hand hides what is seen along a direction, camera frame; NULL: nothing does */
	bool (*covered)(const void *context, const float direction[3]);
	/* Most light about a direction, anchor frame, by all that the camera has seen, in the unit
	 * of cells->radiance; NULL: that is not known */
	float (*known)(const void *context, const float direction[3]);
	const void *context;
};

/* Learn from it. */
void lp_stuck_learn(struct lp_stuck *stuck, const struct lp_stuck_look *look);

/* The anchor frame is another: directions in it turn by `turn`. */
void lp_stuck_turn(struct lp_stuck *stuck, const struct lp_rotation *turn);

#ifdef __cplusplus
}
#endif

#endif
