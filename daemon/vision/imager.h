/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The whole of vision: frames in, one panorama of linear radiance out. Every frame corrects what is
 * known (vision/map/radiance_map.h), turned into the frame of the map as the camera is turned.
 * Several cameras in one box are turned together; each frame tells of the part of the sphere that
 * its camera sees. One thread.
 *
 * Two frames of reference: the camera's (the probe frame), and the anchor frame, in which the
 * panorama and the lamps found in it are. They are the same until the camera turns.
 */
#ifndef LP_VISION_IMAGER_H
#define LP_VISION_IMAGER_H

#include <stdbool.h>
#include <stdint.h>

#include "include/frame.h"
#include "light/film/polarization.h"
#include "light/math/rotation.h"
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
struct lp_polarization_grid;

#define LP_MOST_REFINE_CELLS 1024 /* camera cells of one lamp */
#define LP_MAX_BRACKET 32 /* exposure settings that are told apart; people take 18 and more */

struct lp_imager_options {
	int panorama_width; /* multiple of 8, 16..LP_PANORAMA_MAX_WIDTH */
	enum lp_decode decode;
	int divisor;	      /* PIXELS: 1, 2, 4, 8 */
	int exact_blocks;     /* BLOCKS: most blocks decoded after all */
	bool follow_turns;    /* see by the frames how the camera turns; false: it never does */
	bool use_orientation; /* follow_turns: and by what they carry (frame.h) */
	struct lp_film film;  /* in front of the lens; gain 0: none */
};

/* What went into the panorama. */
struct lp_imager_status {
	int exposure_count;	   /* of the newest frame's camera, and so on */
	float longest_exposure_us; /* times gain; NAN: unknown */
	bool exposure_unknown;
	/* 1 sigma, relative, of the scale of light against that of the first frame; 0 where
	 * exposures are known */
	float scale_sigma;
	bool invalid_samples; /* NaN or negative ones were left out */
	float mean_code;      /* of the longest exposure, 0..255; NAN: float frames */
	/* 1 sigma of irradiance from the panorama's own uncertainty (vision/map/radiance_map.h) */
	float irradiance_sigma;
	float clipped_share; /* of the light: what clipped cells hold at least */
	/* Of the sphere, what clips in the shortest exposure of the newest frame's camera; of
	 * several cameras the map may know more, as by stills. */
	float newest_clips;
	float changed;		  /* share of the light that the newest frame showed changed */
	float rotation_sigma_deg; /* of lp_imager_rotation(); 0: the camera holds still */
	/* The newest frame contradicts what is known, and no turn of the camera explains it. */
	bool rotation_is_unknown;
	float banding;	    /* amplitude of the bands that flicker draws; 0: none are seen */
	bool covered;	    /* something hides part of the camera's view */
	bool lost_view;	    /* a camera is away, and no other one sees what it saw */
	float hidden_s;	    /* for how long by now something is covered or lost */
	float hidden_share; /* of the light: what was known there */
	/* 1 sigma of all light, relative, from how well cameras are brought to one scale */
	float cameras_sigma;
	float veil_sigma; /* the same, from how well the lens' glare is known */
	/* 1 sigma of all light, relative, from responses; and exposures contradict each other as
	 * none explains (vision/response/linearity.h) */
	float response_sigma;
	bool response_fails;
	int places_left_out; /* cells of all cameras' pictures that shine by themselves */
	bool fills_view;     /* of some of those nothing is known but what is beside them */
	bool angles_missing; /* a film, but too few of its angles to tell how light is polarized */
};

/* How the camera turns. */
struct lp_imager_turn {
	float rate_deg_per_s;
	/* 1 sigma of how fast it may turn while it seems to hold still; 0: that would be seen */
	float unseen_rate_deg_per_s;
	float sigma_deg;    /* of lp_imager_rotation(); 0: the camera holds still */
	float time_sigma_s; /* 1 sigma of when the newest frame was exposed */
	bool goes; /* in the last second the probe has gone so far that pictures may seem turned */
};

/* What the newest frame carries of its orientation. */
struct lp_imager_told {
	bool known;
	struct lp_rotation rotation; /* camera to what tells it, at the frame's middle */
	float sigma_deg;	     /* 1 sigma about each axis, also from how late it may be */
	double own_sigma_rad, late_sigma_s; /* the two apart */
	double rate_rad_s[3];		    /* of the turn, in that frame */
	bool left_out;			    /* what frames carry contradicts what they show */
	/* Where the camera was, in that frame; 1 sigma along each axis, 0: not known. */
	double position_m[3], position_sigma_m;
	uint32_t by;  /* who tells it, as a number */
	int64_t t_ns; /* the frame's middle */
};

/* The camera is borrowed until destroy. */
int lp_imager_create(const struct lp_camera *camera, const struct lp_imager_options *options,
		     struct lp_imager **imager);

/* One more camera, borrowed until destroy; lp_frame.camera says which one a frame is of. -EINVAL:
 * more than LP_MAX_CAMERAS; -ENOMEM. */
int lp_imager_add_camera(struct lp_imager *imager, const struct lp_camera *camera);
void lp_imager_destroy(struct lp_imager *imager); /* accepts NULL; releases the frames it holds */

/*
 * Takes over the reference to `frame` and decodes it. It does not count yet: lp_imager_accept()
 * says with which exposure it does; the next load forgets it otherwise. expected_us (times gain;
 * NAN: unknown) is what it will most likely be. -EBADMSG: frame refused, logged; all else is as
 * before. -EAGAIN: a still that tells nothing any more, logged; all else is as before. -ENOMEM.
 */
int lp_imager_load(struct lp_imager *imager, struct lp_frame *frame, float expected_us);

/* The frame loaded last was exposed for exposure_us, and not for what was expected: scale it.
 * Needed only by who looks at it before lp_imager_accept(), which does the same. */
void lp_imager_settle(struct lp_imager *imager, float exposure_us);

/* The frame loaded last was exposed for exposure_us (times gain; NAN: unknown): it corrects the map
 * and refresh the panorama. */
int lp_imager_accept(struct lp_imager *imager, float exposure_us);

/* Load and accept with the exposure that the frame itself states. */
int lp_imager_add(struct lp_imager *imager, struct lp_frame *frame);

/* Forget what is known of the light that the camera of the newest frame sees: its next frame that
 * is accepted starts anew. */
void lp_imager_forget(struct lp_imager *imager);

/* The camera streams (again): what its frames have shown of their exposures counts no more. */
void lp_imager_begin(struct lp_imager *imager, int camera);

/* The camera is away. What it has shown stays, less and less certain. */
void lp_imager_lose(struct lp_imager *imager, int camera);

/* Another exposure is commanded, or the camera begins, with whatever exposure: a sudden change of
 * all that its frames show is most likely that. */
void lp_imager_expect_exposure(struct lp_imager *imager, int camera);

/* Go on with the scale of another imager that saw the same camera until now, for exposures that are
 * not told; and with what it has found to shine by itself. */
void lp_imager_inherit(struct lp_imager *imager, const struct lp_imager *from);

#define LP_MAX_CANDIDATES 6

/*
 * How the frame loaded last compares with the radiance known so far: codes[a][b] is how much it
 * differs from what the a-th exposure predicts, in codes of a square-root response, mean over the
 * cells where the b-th predicts something else. NAN: too few of them tell the two apart.
 */
struct lp_exposure_matches {
	float codes[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES];
};
void lp_imager_match(const struct lp_imager *imager, const float *exposures_us, int count,
		     struct lp_exposure_matches *matches);

/* Exposures of a camera in the panorama: the newest, and those since the light last changed. */
int lp_imager_current_exposures(const struct lp_imager *imager, int camera);

/* 1 for each cell of the panorama (anchor frame) along which the camera of the newest frame looks,
 * else 0. */
void lp_imager_view(const struct lp_imager *imager, uint8_t *cells);

const struct lp_grid *lp_imager_grid(const struct lp_imager *imager);
/* Anchor frame. Its cells are the map's own, 0 where UNSEEN: nobody may write to them. Owned by the
 * imager; valid until the next load. */
const struct lp_panorama *lp_imager_panorama(const struct lp_imager *imager);

/* Whether all cameras together see so little of the sphere at a time that they are turned to see
 * the rest. False until each has taken a frame. */
bool lp_imager_sees_little(const struct lp_imager *imager);

/* Camera to anchor frame, at the newest frame's capture time. Valid until the next load. */
const struct lp_rotation *lp_imager_rotation(const struct lp_imager *imager);

/* The same at t_ns, after the newest frame, if it goes on turning as it does. */
struct lp_rotation lp_imager_rotation_at(const struct lp_imager *imager, int64_t t_ns);

/* The film in front of the newest frame, anchor frame. NULL: there is none. Valid until the next
 * load. */
const struct lp_film_view *lp_imager_film(const struct lp_imager *imager);

/* How the light of a lamp's cells is polarized, anchor frame; not known without a film. */
struct lp_polarization lp_imager_polarization(const struct lp_imager *imager,
					      const struct lp_lamp_finder *finder,
					      const struct lp_lamp *lamp);

/* By the floor or by its own surfaces, a quarter turn (stokes_map.h); false without a film. */
bool lp_imager_film_seems_turned(const struct lp_imager *imager);

/* How light is polarized, camera frame, as of the newest frame. False: there is no film. */
bool lp_imager_polarization_grid(const struct lp_imager *imager, struct lp_polarization_grid *grid);

/* Lamps say how the frame just loaded is turned (light/turn/motion.h:
 * lp_motion_correct_by_landmarks()).
 */
void lp_imager_correct_rotation(struct lp_imager *imager, const double pull[3],
				const double information[3][3]);

/*
 * When the camera has come to rest: make its frame the anchor frame. True: that was done, and
 * `turn` is the rotation from the old anchor frame to the new one, by which the caller turns what
 * it keeps.
 */
bool lp_imager_rest(struct lp_imager *imager, struct lp_rotation *turn);

/* Full scale of the newest frame to radiance. */
float lp_imager_scale(const struct lp_imager *imager);

/* Lamps flicker by so much (root mean square, relative; 0: they do not): from the next frame on
 * exposures shorter than the mains' period tell the less. */
void lp_imager_expect_flicker(struct lp_imager *imager, float depth);

struct lp_imager_turn lp_imager_turn(const struct lp_imager *imager);
struct lp_imager_told lp_imager_told(const struct lp_imager *imager);
void lp_imager_status(const struct lp_imager *imager, struct lp_imager_status *status);

/*
 * Look at the newest frame's full-resolution pixels behind a lamp of the panorama: direction,
 * irradiance and its sigma, solid angle and the direction's sigma become theirs; CLIPPED says
 * whether it is saturated in this frame. False: more than `most_cells` camera cells hold the lamp's
 * light, where the grid serves as well, or the frame does not show it; it is left as it was.
 */
bool lp_imager_refine(struct lp_imager *imager, const struct lp_lamp_finder *finder,
		      struct lp_lamp *lamp, int most_cells);

/*
 * 1 sigma, relative, of a lamp's irradiance from how the newest frame recorded it: the camera's
 * response and white balance, and the rounding of codes (vision/camera/code_noise.h). 0 for float
 * frames.
 */
float lp_imager_strength_sigma(const struct lp_imager *imager, const struct lp_lamp *lamp);

/*
 * 1 sigma, relative, of what the panorama holds of a lamp: of a lamp that no newer frame could
 * measure it grows with time, in all of its cells alike. Cells that are only a lower bound are left
 * out.
 */
float lp_imager_cells_sigma(const struct lp_imager *imager, const struct lp_lamp_finder *finder,
			    const struct lp_lamp *lamp);

#ifdef __cplusplus
}
#endif

#endif
