/* SPDX-License-Identifier: Apache-2.0 */
/* What the files of the imager share. */
#ifndef LP_VISION_IMAGER_INTERNAL_H
#define LP_VISION_IMAGER_INTERNAL_H

#include "include/frame.h"
#include "include/panorama.h"
#include "light/turn/imu.h"
#include "light/turn/motion.h"
#include "light/turn/shear.h"
#include "light/turn/unseen_turn.h"
#include "vision/map/residual.h"
#include "vision/eye.h"
#include "vision/imager.h"
#include "vision/map/radiance_map.h"
#include "vision/turn/frame_time.h"

struct lp_alignment;
struct lp_lookup;
struct lp_stokes_map;

/* An alignment that fewer of the compared pixels agree with is none. */
#define LP_LEAST_AGREEMENT 0.4F
#define LP_CELL_MAX_PX 64 /* pixels of one camera cell */

/* What cameras that are away leave unseen (hidden.c). */
struct lp_lost {
	int64_t since_ns; /* when the first of them went away; 0: none is */
	bool view;	  /* no camera that is there looks at a part of what is known */
	float share;	  /* of the light that is known: that part's */
};

/* How the camera turns (follow.c). */
struct lp_follow {
	struct lp_motion motion;
	int64_t t_ns;		 /* that motion.rotation is of; 0: nothing has been seen */
	struct lp_motion before; /* motion before the newest frame, of t_before_ns */
	int64_t t_before_ns;
	float agreement;	   /* of the last alignment */
	double elapsed_s;	   /* between the newest frame and the one before; 0: not told */
	struct lp_imu_sample told; /* what the newest frame carries of its orientation */
	struct lp_imu_sample told_before; /* of the newest frame that is no still */
	struct lp_imu imu;
	struct lp_unseen_turn unseen;
	/* Where the probe was, as it is told, mean of the last second or so; and by how much the
	 * way from there turns pictures against the map: 1 sigma, 0 while nobody tells. */
	double from_m[3];
	bool has_from;
	double parallax_rad;
};

/* A polarizing film before the lens (film.c). */
struct lp_imager_film {
	struct lp_stokes_map *stokes; /* NULL: no film */
	struct lp_film_view view;     /* of the newest frame, anchor frame; only if there is one */
	/* 1 / G per cell in the camera's frame (light/film/sheet.h), with the wheel at over_deg;
	 * NULL: the film lets pass the same everywhere. */
	float *over;
	float over_deg;		 /* INFINITY: not yet */
	float wheel_deg;	 /* of the newest frame; NAN: unknown */
	struct lp_stokes angles; /* what unpolarized light would tell by the angles so far */
};

/* Workspace for the pixels behind a lamp (refine.c). */
struct lp_lamp_work {
	float (*pixels)[3]; /* of LP_MOST_REFINE_CELLS camera cells */
	int32_t *behind;    /* panorama cells behind a lamp, camera frame */
	uint8_t *taken;	    /* per panorama cell: it is among them */
};

struct lp_imager {
	struct lp_imager_options options;
	struct lp_grid *grid;
	int eye_count;
	struct lp_eye eyes[LP_MAX_CAMERAS];
	struct lp_eye *eye;	  /* of the newest frame */
	struct lp_gain *compared; /* workspace: two cameras' cells; NULL: there is one */

	int64_t t_capture_ns;	   /* of the newest frame */
	struct lp_frame about;	   /* the newest frame, without its picture */
	struct lp_frame_time time; /* of the newest frame */
	bool loaded;		   /* it has not been accepted yet */
	float late_s;		   /* it was taken so long before t_capture_ns: a still; else 0 */
	int64_t t_moved_ns; /* of the last frame in which the box turned, or much light changed */
	struct lp_lost lost;

	struct lp_radiance_map *map;
	struct lp_panorama panorama; /* the map, as the rest of the pipeline sees it */
	int64_t t_map_ns;	     /* of the last frame that the map has observed */
	struct lp_follow turn;

	/* Where the map's cells lie in the camera's frame, while the camera is turned. */
	struct lp_lookup *lookup;
	struct lp_alignment *alignment;
	float (*turned)[4];
	uint8_t *turned_flags;
	float *step2, *place_variance; /* lp_observation */

	struct lp_imager_film film;
	struct lp_map_update update; /* of the newest observation */
	float flicker;		     /* lp_imager_expect_flicker() */
	/* unknown_exposure.c */
	int watched[LP_GAIN_CELLS]; /* each eye's gain.cells[] in the panorama */
	int watched_count;
	bool is_relative; /* the map began with frames that did not tell their exposure */

	struct lp_banding_samples band_samples;

	struct lp_lamp_work lamp;
};

/* several.c: a still that is older than what the map knows (frame.h). False: since it was taken
 * the box has turned, or the light has changed: it tells nothing. */
bool lp_imager_place_still(struct lp_imager *imager, const struct lp_frame *frame);
/* The frame before was exposed so much later, but for less long. */
bool lp_imager_is_late(const struct lp_imager *imager, double elapsed_s);
/* Whether other cameras have shown anything. */
bool lp_imager_others_know(const struct lp_imager *imager, const struct lp_eye *eye);
/* Forget what the camera of the newest frame looks at, as far as it is known where that is; and
 * (imager.c) everything. */
void lp_imager_forget_view(struct lp_imager *imager);
void lp_imager_forget_all(struct lp_imager *imager);
/* The newest frame against the other cameras': those further on in the list are brought to the
 * scale and the colours of those before them. */
void lp_imager_compare_cameras(struct lp_imager *imager);

/* Since the frame of the same camera before the newest one; 0: there is none. */
double lp_imager_eye_elapsed_s(const struct lp_imager *imager);

/* imager_decode.c: how closely a frame of the camera at hand is read. */
struct lp_decode_options lp_imager_decode_options(const struct lp_imager *imager,
						  const struct lp_frame *frame);

/* The newest frame beside the map (imager_residual.c). */
struct lp_residual lp_imager_residual(const struct lp_imager *imager);

/* Full scale to radiance of the newest frame, if it was exposed for exposure_us (times gain; NAN:
 * as the frame before). */
float lp_imager_scale_of(const struct lp_imager *imager, float exposure_us);

/* film.c: what the options name, if they name one; -ENOMEM. */
int lp_imager_create_film(struct lp_imager *imager);
/* The film as it stood in the newest frame, in the frame of the map. */
void lp_imager_place_film(struct lp_imager *imager);
/* By what light of each cell is multiplied for what the film takes of it off the axis, camera
 * frame; NULL: the same everywhere. And what the film lets pass in one direction of the picture. */
const float *lp_imager_over_film(struct lp_imager *imager);
float lp_imager_film_gain(const struct lp_imager *imager, const float direction[3]);
/* Behind a film: mark what the film, which turns with the camera, would turn the picture by. */
void lp_imager_leave_out(struct lp_imager *imager, const struct lp_rotation *to_map,
			 struct lp_observation *seen);
/* What the film's angle tells, and then the frame as it would be without the film. */
void lp_imager_see_through(struct lp_imager *imager, struct lp_observation *seen);

/* How the newest frame's rows look elsewhere, by how fast the camera turns. */
struct lp_shear lp_imager_shear(const struct lp_imager *imager);

/* The newest frame's cells on the panorama's grid, with their marks. */
void lp_imager_map(struct lp_imager *imager);

/* The newest frame's scale is another. */
void lp_imager_rescale(struct lp_imager *imager, float scale);

/* unknown_exposure.c: choose the cells of the panorama that are watched. */
void lp_imager_watch(struct lp_imager *imager);
/* glare/look.c: what the newest frame says of the lens' glare, which is then taken off anew; and
 * how certain that leaves the frame. */
void lp_imager_look_through_veil(struct lp_imager *imager);
void lp_imager_weigh_veil(struct lp_imager *imager, struct lp_observation *seen);
/* response/exposures_agree.c: what the newest frame says of its camera's response. */
void lp_imager_learn_response(struct lp_imager *imager);
/* bands.c: does the newest frame, before the map learns from it, show bands? */
void lp_imager_look_for_bands(struct lp_imager *imager);

/* unknown_exposure.c: where the newest frame does not tell its exposure, find its scale by the map:
 * roughly, before it is known where the camera looks; and in earnest. */
void lp_imager_expect_scale(struct lp_imager *imager);
void lp_imager_find_scale(struct lp_imager *imager);
/* Squared change of the map's luminance from a cell to its neighbours. */
float lp_imager_step2(const struct lp_imager *imager, int cell);
/* Nothing is left to compare the next frame with. */
void lp_imager_forget_scale(struct lp_imager *imager);
/* When the map is turned: how it lies to what is known of the scale, before and afterwards. */
float lp_imager_scale_in_map(const struct lp_imager *imager, struct lp_gain *gain);
void lp_imager_turn_scale(const struct lp_imager *imager, struct lp_gain *gain, float in_map);

/* Where the camera looks in the newest frame (follow.c); the same if the frame was taken at another
 * time than it seemed; and, once all that shows it has been heard, what that says of the IMU.
 */
void lp_imager_follow(struct lp_imager *imager);
void lp_imager_follow_again(struct lp_imager *imager);
void lp_imager_followed(struct lp_imager *imager);

/* hidden.c: is the lens covered in the newest frame? Where it is, the frame tells nothing of the
 * light. */
void lp_imager_look_for_cover(struct lp_imager *imager);
/* stuck/left_out.c: which places of the picture shine by themselves, by the newest frame. */
void lp_imager_learn_stuck(struct lp_imager *imager);
/* How much of the known light is covered, or seen only by a camera that is away. */
void lp_imager_weigh_hidden(struct lp_imager *imager);

#endif
