/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The scale of frames that do not tell their exposure, as of cameras that expose automatically: one
 * more unknown. Each frame is compared, cell by cell, with what these cells have shown for half a
 * minute; the radiance map itself forgets within a few frames, so that its scale would drift.
 *
 * Between two frames the light, the exposure, or both may have changed:
 *  - most of the picture became brighter by one factor, as a new exposure makes it: the scale
 *    follows, and the light stays as it was;
 *  - it became brighter unevenly, as a lamp that is switched makes it: the scale stays;
 *  - it became brighter by one factor, but suddenly, after the exposure had been at rest: automatic
 *    exposure does not do that by itself. The light has changed, and the scale stays. Nothing but
 *    its suddenness tells it, so that the scale is less certain from then on.
 *
 * Pure computation on numbers; one thread; no allocation.
 */
#ifndef LP_VISION_DOUBT_GAIN_H
#define LP_VISION_DOUBT_GAIN_H

#ifdef __cplusplus
extern "C" {
#endif

#define LP_GAIN_CELLS 4096
/* Neighbours err alike: so many cells count as one. */
#define LP_CORRELATED_CELLS 20

/* A cell that is watched. */
struct lp_gain_cell {
	float seen;	 /* in the newest frame: logarithm of its radiance on the scale held so far;
			  * NAN: too dark, too bright, or not seen */
	float sigma;	 /* 1 sigma of it */
	float reference; /* the same as it was on average; NAN: not known */
	int count;	 /* frames that this is the mean of */
	int strange;	 /* frames in a row that contradict it */
};

/* The factor that most of the cells have in common. */
struct lp_gain_look {
	float log_gain;	 /* of the frame over what is known */
	float sigma;	 /* 1 sigma */
	float agreement; /* share of the compared cells that have it; 0: nothing can be compared */
};

/* Plain data; lp_gain_init() starts it. */
struct lp_gain {
	float scale;	/* full scale to radiance, of the newest frame */
	float first;	/* the scale of the first frame */
	float variance; /* of the scale's logarithm, without what the response adds */
	float own;	/* 1 sigma of the newest frame's scale against what is known */
	float unrest;	/* how much it changed lately */
	float usual;	/* agreement of the frames before */
	int lost;	/* frames in a row that did not tell it */
	int count;	/* of cells; all of them are set by the caller */
	struct lp_gain_cell cells[LP_GAIN_CELLS];
	float sorted[LP_GAIN_CELLS]; /* workspace */
};

/* Nothing is known, and no cell is watched. */
void lp_gain_init(struct lp_gain *gain, float scale);

/* Compare what is seen with what is known. */
struct lp_gain_look lp_gain_look(struct lp_gain *gain);

/* Find the scale of the frame that was looked at, elapsed_s after the one before it, and learn from
 * it. */
void lp_gain_follow(struct lp_gain *gain, const struct lp_gain_look *look, float elapsed_s);

/* So much of the light changed at once (share): some of that may have been taken for a change of
 * the scale. */
void lp_gain_disturb(struct lp_gain *gain, float changed);

/* What is seen of the cells, plus `correction`, is what is known from now on. sigma: 1 sigma of
 * what that may do to the scale. */
void lp_gain_anew(struct lp_gain *gain, float correction, float sigma);

/* 1 sigma, relative, of the scale against that of the first frame. */
float lp_gain_sigma(const struct lp_gain *gain);

#ifdef __cplusplus
}
#endif

#endif
