/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What tells the orientation besides the camera's frames: the head poses of one client, or a
 * sensor. They are
 * kept for a moment, and each frame is stamped with how the probe was turned in the middle of its
 * exposure. What is told wrongly shows in the pictures, and is found out there
 * (light/turn/imu.h). Loop thread.
 */
#ifndef LP_APP_BOX_ORIENTATION_H
#define LP_APP_BOX_ORIENTATION_H

#include <stdbool.h>
#include <stdint.h>

#include "estimate/pipeline.h"
#include "light/turn/orientation_track.h"

struct lp_frame;
struct lp_health;

/* How the probe sits on what tells the orientation. */
struct lp_mount {
	struct lp_rotation rotation; /* probe frame to that of the head, or of the sensor */
	double sigma_rad;
	double offset_m[3]; /* where the probe is in the frame of the head */
};

/* From an INI file with a section [mount]; "": identity, nothing is off. -ENOENT, -EBADMSG, logged
 * as FILE:LINE. */
int lp_mount_read(const char *path, struct lp_mount *mount);

struct lp_orientation_teller {
	enum lp_orientation_kind kind;
	struct lp_mount mount;
	struct lp_health *health; /* borrowed */
	struct lp_orientation_track track;
	const void *client;   /* whose poses are used; NULL: nobody's */
	uint32_t tellers;     /* how many there were, this one included: lp_frame.orientation_by */
	int64_t t_sample_ns;  /* when the newest came; 0: none yet */
	int64_t t_stamped_ns; /* when a frame was stamped last; 0: not since somebody tells */
	int64_t t_unstamped_ns; /* when one could not be, for the newest sample was too old */
	double behind_ms;	/* by so much, then */
	double walk; /* of the last frame that was stamped (light/turn/orientation_track.h) */
	int64_t t_start_ns;
	bool silent, late, contradicted, misplaced; /* faults that are told */
};

/* `health` is told of faults; borrowed. */
void lp_orientation_init(struct lp_orientation_teller *teller, enum lp_orientation_kind kind,
			 const struct lp_mount *mount, struct lp_health *health);

/*
 * A client's head pose, at the sample's time. 0: it counts; 1: it does, and it is this client's
 * first: what WORLD is has changed. -EOPNOTSUPP: poses are not used. -EBUSY: another client's are.
 * -EINVAL, -ESTALE: as lp_orientation_track_add() says.
 */
int lp_orientation_pose(struct lp_orientation_teller *teller, const void *client,
			const struct lp_orientation_sample *sample);

/* What a sensor has told; a sample that makes no sense is left out. */
void lp_orientation_sensed(struct lp_orientation_teller *teller,
			   const struct lp_orientation_sample *sample);

/* A client has left. */
void lp_orientation_client_left(struct lp_orientation_teller *teller, const void *client);

/* Stamp a frame, where it is told how it was turned. */
void lp_orientation_frame(struct lp_orientation_teller *teller, struct lp_frame *frame);

/* An estimate says whether what was told agreed with the pictures. What the mount is off by, which
 * is the same for all frames, adds to its sigma. */
void lp_orientation_judged(struct lp_orientation_teller *teller,
			   struct lp_estimate_orientation *orientation);

/* Several times a second. */
void lp_orientation_tick(struct lp_orientation_teller *teller, int64_t now_ns);

#endif
