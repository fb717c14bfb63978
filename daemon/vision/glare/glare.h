/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The veil that a lens lays over its picture: of the light x that reaches it a picture shows
 *
 *	y = (1 - even - around) x + even (mean of x) + around (x, spread around where it comes from)
 *
 * by the shares that the camera file states (struct lp_glare_shares), of each lens by itself. So x
 * is (y - veil) / (1 - even - around). The veil comes of all light, also of what clips in this
 * frame: of a cell that the frame shows well that counts, of others what the map holds.
 *
 * A panorama does not say whether one lens made it or two, ahead and behind: the even part is the
 * mean of both, and its sigma knows half their difference.
 *
 * No place of a picture holds less light than the veil. Where places do, the shares are too large:
 * the veil is taken off by as much as they allow, and is the less certain.
 *
 * All in the camera's frame, on the panorama's grid; one thread. All storage is allocated at
 * create().
 */
#ifndef LP_VISION_GLARE_GLARE_H
#define LP_VISION_GLARE_GLARE_H

#include <stdbool.h>
#include <stdint.h>

#include "vision/camera/camera.h"
#include "vision/glare/spread.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lp_residual;

/* A lens, or what may be one of a panorama. Per node: */
struct lp_glare_lens {
	float source[LP_VEIL_NODES]; /* share of its light that enters */
	float even[LP_VEIL_NODES];   /* share of this lens in the even veil there */
	/* What enters times `into` is spread around, and counts times `out_of`: so even light stays
	 * even, and none is lost. */
	float into[LP_VEIL_NODES], out_of[LP_VEIL_NODES];
	bool spreads;  /* else those are 0 */
	float area_sr; /* that it sees */
};

struct lp_glare {
	struct lp_glare_shares shares; /* as stated */
	float believed;		       /* of them, 0 .. 1 */
	float allowed; /* of that, by the newest picture; looked at once after each look */
	bool looked;
	bool known;  /* a frame has been looked at: until then no veil is taken off */
	float sigma; /* of all light, relative, from how well the veil is known; 0: none yet */
	bool told;   /* the log has told that less is believed */
	/* Of a panorama: the whole sphere, and two halves. */
	bool is_panorama;
	int lens_count;
	struct lp_glare_lens lens[LP_MAX_LENSES];
	struct lp_spread *spread;
	float flux[LP_VEIL_NODES][4], work[LP_VEIL_NODES][4]; /* radiance times solid angle */
	float veil[LP_VEIL_NODES][4];			      /* radiance */
	float variance[LP_VEIL_NODES];			      /* of its luminance */
	/* Per row and column of the panorama: the node before, and how far behind it. */
	int width, height;
	int *row_node, *column_node;
	float *row_share, *column_share;
	float *row_sr; /* of a cell */
	int *nearest;  /* node of each cell */
	float *cells;  /* luminance of the veil, camera frame */
	/* That and its variance in the map's frame: lp_glare_turn(). */
	float *turned, *turned_variance;
};

/* `camera` states glare. The panorama's width: of include/panorama.h. -ENOMEM. */
int lp_glare_create(const struct lp_camera *camera, int panorama_width, struct lp_glare **glare);
void lp_glare_destroy(struct lp_glare *glare); /* accepts NULL */

/* What of the light passes without being spread; 1 until a frame has been looked at. */
float lp_glare_kept(const struct lp_glare *glare);

/* Look at the newest frame, from which the veil as known so far has been taken, and at the map:
 * the veil becomes that of their light. over_film: by which a film has made light more, per cell;
 * NULL: by nothing. */
void lp_glare_look(struct lp_glare *glare, const struct lp_residual *frame, const float *over_film);
/* Add light to `flux`: radiance and solid angle of a cell of the camera. */
struct lp_glare_cell {
	const float *light; /* R, G, B, luminance */
	int cell;
	float sr;
};
void lp_glare_add(struct lp_glare *glare, const struct lp_glare_cell *cells, int count);
/* The veil of `flux`; the last part of lp_glare_look(). */
void lp_glare_spread(struct lp_glare *glare);

/*
 * Take the veil off a picture. from, to: cells of the panorama's grid; may be the same. flags: enum
 * lp_cell_flag. `dark`: light that a picture of this exposure cannot tell from none, radiance.
 */
void lp_glare_take_off(struct lp_glare *glare, const float (*from)[4], const uint8_t *flags,
		       float dark, float (*to)[4]);

/* Fill `turned` and `turned_variance`; over_film as above. */
void lp_glare_turn(struct lp_glare *glare, const struct lp_residual *frame, const float *over_film);

/* Veil in one direction, R, G, B, luminance. */
void lp_glare_at(const struct lp_glare *glare, const float direction[3], float veil[4]);

#ifdef __cplusplus
}
#endif

#endif
