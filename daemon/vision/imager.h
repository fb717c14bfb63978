/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The whole of vision: frames in, one merged panorama of linear radiance out. Keeps the newest
 * frame of every exposure of a bracket, so that each new frame refreshes the panorama. One thread.
 */
#ifndef LP_VISION_IMAGER_H
#define LP_VISION_IMAGER_H

#include <stdbool.h>

#include "include/frame.h"
#include "vision/exposure.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lp_camera;
struct lp_grid;
struct lp_imager;
struct lp_lamp;
struct lp_lamp_finder;
struct lp_panorama;

#define LP_MAX_BRACKET (LP_FRAMES_HELD - 1)

struct lp_imager_options {
	int panorama_width; /* multiple of 8, 16..LP_PANORAMA_MAX_WIDTH */
	enum lp_decode decode;
	int divisor;	  /* PIXELS: 1, 2, 4, 8 */
	int exact_blocks; /* BLOCKS: most blocks decoded after all */
};

/* What went into the panorama. */
struct lp_imager_status {
	int exposure_count;
	int current_count; /* of these, the newest, and those since the light last changed or the
			    * camera turned */
	float longest_exposure_us; /* times gain; NAN: unknown */
	bool exposure_unknown;
	bool invalid_samples; /* NaN, infinite or negative ones were left out */
	float mean_code;      /* of the longest exposure, 0..255; NAN: float frames */
};

/* The camera is borrowed until destroy. */
int lp_imager_create(const struct lp_camera *camera, const struct lp_imager_options *options,
		     struct lp_imager **imager);
void lp_imager_destroy(struct lp_imager *imager); /* accepts NULL; releases the frames it holds */

/*
 * Takes over the reference to `frame` and decodes it. It does not count yet: lp_imager_accept()
 * says with which exposure it does; the next load forgets it otherwise. expected_us (times gain;
 * NAN: unknown) is what it will most likely be. -EBADMSG: frame refused, logged; all else is as
 * before. -ENOMEM.
 */
int lp_imager_load(struct lp_imager *imager, struct lp_frame *frame, float expected_us);

/* The frame loaded last was exposed for exposure_us (times gain; NAN: unknown): merge it and
 * refresh the panorama. */
int lp_imager_accept(struct lp_imager *imager, float exposure_us);

/* Load and accept with the exposure that the frame itself states. */
int lp_imager_add(struct lp_imager *imager, struct lp_frame *frame);

/* From the next merge on only these exposures count; what others showed is of the past. */
void lp_imager_keep(struct lp_imager *imager, const float *exposures_us, int count);

/* Forget all exposures: the next one accepted starts anew. */
void lp_imager_forget(struct lp_imager *imager);

/* How the frame loaded last compares with the radiance known so far, if it was exposed for
 * exposure_us: mean difference in codes (of a square-root response) over what both can tell. */
struct lp_exposure_match {
	float difference_codes; /* NAN: nothing to compare */
	float compared;		/* share of the cells */
};
struct lp_exposure_match lp_imager_match(const struct lp_imager *imager, float exposure_us);

const struct lp_grid *lp_imager_grid(const struct lp_imager *imager);
/* Owned by the imager; valid and changeable until the next add. */
struct lp_panorama *lp_imager_panorama(struct lp_imager *imager);
void lp_imager_status(const struct lp_imager *imager, struct lp_imager_status *status);

/*
 * Look at the full-resolution pixels behind a lamp, of the longest exposure that does not clip
 * there: direction, irradiance, solid angle and the direction's sigma become theirs. False: more
 * than `most_cells` camera cells hold the lamp's light, where the grid serves as well, and it is
 * left as it was.
 */
bool lp_imager_refine(struct lp_imager *imager, const struct lp_lamp_finder *finder,
		      struct lp_lamp *lamp, int most_cells);

/*
 * 1 sigma, relative, of a lamp's irradiance from how it was recorded: the camera's response and
 * white balance, and the rounding of codes (vision/code_noise.h) in the longest exposure that does
 * not clip it. 0 for float frames.
 */
float lp_imager_strength_sigma(const struct lp_imager *imager, const struct lp_lamp *lamp);

#ifdef __cplusplus
}
#endif

#endif
