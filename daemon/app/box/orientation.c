/* SPDX-License-Identifier: Apache-2.0 */
#include "app/box/orientation.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>

#include "base/clock.h"
#include "base/ini.h"
#include "base/log.h"
#include "base/param.h"
#include "include/frame.h"
#include "include/orientation.h"
#include "serve/health.h"
#include "vision/turn/frame_time.h"

#define DEG (M_PI / 180.0)
/* Who tells nothing for so long makes room for another. */
#define SILENCE_NS LP_NS_PER_S
#define CONTRADICTS "orientation-contradicts"
#define LATE "orientation-late"
#define MISPLACED "orientation-place"
#define NO_POSE                                                         \
	"orientation: receive: no client has sent a pose for a second " \
	"— does the app send its head pose?"
#define NO_SAMPLE                                                         \
	"orientation: receive: the sensor has told nothing for a second " \
	"— is it connected? The log says what was tried"

/* ---------------------------------------------------------------- the mount */

struct mount_fields {
	struct lp_floats rotation_xyzw, offset_m;
	float sigma_deg;
};

static const struct lp_param mount_list[] = {
	{"rotation_xyzw", LP_PARAM_FLOATS, offsetof(struct mount_fields, rotation_xyzw), .min = -1,
	 .max = 1},
	{"offset_m", LP_PARAM_FLOATS, offsetof(struct mount_fields, offset_m), .min = -10,
	 .max = 10},
	{"sigma_deg", LP_PARAM_FLOAT, offsetof(struct mount_fields, sigma_deg), .min = 0,
	 .max = 180},
};
static const struct lp_params mount_params = LP_PARAMS(mount_list);

static int take_fields(const char *path, const struct mount_fields *fields, struct lp_mount *mount)
{
	const float *q = fields->rotation_xyzw.values;
	const double square = (double)q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];

	if (fields->rotation_xyzw.count != 4 || fabs(square - 1.0) > LP_MOST_NOT_UNIT) {
		lp_error(path, "rotation_xyzw",
			 "must be a unit quaternion x, y, z, w — `lightprobe align` writes it");
		return -EBADMSG;
	}
	mount->rotation = lp_rotation_of_quaternion((const double[]){q[0], q[1], q[2], q[3]});
	mount->sigma_rad = fields->sigma_deg * DEG;
	if (fields->offset_m.count != 0 && fields->offset_m.count != 3) {
		lp_error(path, "offset_m",
			 "must be x, y, z: where the probe is from the head, in "
			 "metres, in the head's axes");
		return -EBADMSG;
	}
	for (int a = 0; a < fields->offset_m.count; a++)
		mount->offset_m[a] = (double)fields->offset_m.values[a];
	return 0;
}

int lp_mount_read(const char *path, struct lp_mount *mount)
{
	static const char *const sections[] = {"mount", NULL};
	struct mount_fields fields = {0};
	struct lp_ini ini = {0};
	int ret;

	*mount = (struct lp_mount){.rotation = lp_rotation_identity()};
	if (!*path)
		return 0;
	ret = lp_ini_read(&ini, path, "check --mount");
	if (ret == 0)
		ret = lp_ini_check_sections(&ini, sections);
	if (ret == 0)
		ret = lp_ini_set(&ini, "mount", &mount_params, &fields);
	if (ret == 0)
		ret = take_fields(path, &fields, mount);
	lp_ini_finish(&ini);
	return ret;
}

/* ---------------------------------------------------------------- what is told */

/* Log and tell a fault when it begins, and take it back when it is over. */
static void set_fault(struct lp_orientation_teller *teller, bool *is_told, const char *id,
		      const char *text)
{
	if (*is_told == (text != NULL))
		return;
	*is_told = text != NULL;
	lp_health_fault(teller->health, id, text);
	if (text)
		lp_warning("orientation", id, "%s", text);
	else
		lp_info("orientation", id, "is over");
}

void lp_orientation_init(struct lp_orientation_teller *teller, enum lp_orientation_kind kind,
			 const struct lp_mount *mount, struct lp_health *health)
{
	*teller = (struct lp_orientation_teller){.kind = kind,
						 .mount = *mount,
						 .health = health,
						 .t_start_ns = lp_clock_ns()};
}

static bool is_silent(const struct lp_orientation_teller *teller, int64_t now_ns)
{
	return !teller->t_sample_ns || now_ns - teller->t_sample_ns > SILENCE_NS;
}

static void begin_with(struct lp_orientation_teller *teller, const void *client)
{
	teller->client = client;
	teller->tellers++;
	teller->t_stamped_ns = teller->t_unstamped_ns = 0;
	lp_orientation_track_clear(&teller->track);
}

int lp_orientation_pose(struct lp_orientation_teller *teller, const void *client,
			const struct lp_orientation_sample *sample)
{
	const int64_t now_ns = lp_clock_ns();
	struct lp_orientation_track former;
	int ret;

	if (teller->kind != LP_ORIENTATION_CLIENT)
		return -EOPNOTSUPP;
	if (teller->client != client && teller->client && !is_silent(teller, now_ns))
		return -EBUSY;
	const bool is_new = teller->client != client;

	if (is_new) {
		former = (struct lp_orientation_track){0};
		ret = lp_orientation_track_add(&former, sample); /* one that counts at all */
		if (ret < 0)
			return ret;
		begin_with(teller, client);
	}
	ret = lp_orientation_track_add(&teller->track, sample);
	if (ret < 0)
		return ret;
	teller->t_sample_ns = now_ns;
	return is_new;
}

void lp_orientation_client_left(struct lp_orientation_teller *teller, const void *client)
{
	if (teller->client == client) {
		begin_with(teller, NULL);
		teller->t_sample_ns = 0;
		teller->t_start_ns = lp_clock_ns();
		/* what was wrong with its poses goes with it */
		set_fault(teller, &teller->contradicted, CONTRADICTS, NULL);
		set_fault(teller, &teller->late, LATE, NULL);
		set_fault(teller, &teller->misplaced, MISPLACED, NULL);
	}
}

void lp_orientation_sensed(struct lp_orientation_teller *teller,
			   const struct lp_orientation_sample *sample)
{
	if (lp_orientation_track_add(&teller->track, sample) == 0)
		teller->t_sample_ns = lp_clock_ns();
}

static void stamp(struct lp_frame *frame, const struct lp_rotation *rotation, double sigma_rad)
{
	double quaternion[4];

	lp_rotation_quaternion(rotation, quaternion);
	for (int i = 0; i < 4; i++)
		frame->orientation[i] = (float)quaternion[i];
	frame->orientation_sigma_deg = (float)(sigma_rad / DEG);
}

/* Where the probe is: the head's place, and the probe's from there. */
static void stamp_position(struct lp_frame *frame, const struct lp_track_reading *reading,
			   const struct lp_mount *mount)
{
	double offset_m[3];

	lp_rotate(&reading->rotation, mount->offset_m, offset_m);
	for (int a = 0; a < 3; a++)
		frame->position_m[a] = reading->position_m[a] + offset_m[a];
	frame->position_sigma_m = (float)reading->position_sigma_m;
}

void lp_orientation_frame(struct lp_orientation_teller *teller, struct lp_frame *frame)
{
	const int64_t t_ns = lp_frame_time(frame, frame->exposure_us).middle_ns;
	struct lp_track_reading reading;

	if (teller->kind == LP_ORIENTATION_FRAMES && !isnan(frame->orientation[0]))
		teller->t_sample_ns = lp_clock_ns();
	if (teller->kind < LP_ORIENTATION_CLIENT)
		return; /* what the frame itself carries stays */
	for (int i = 0; i < 4; i++)
		frame->orientation[i] = NAN;
	frame->orientation_sigma_deg = NAN;
	frame->position_sigma_m = 0.0F;
	frame->t_orientation_ns = t_ns;
	frame->orientation_by = teller->tellers;
	if (lp_orientation_track_at(&teller->track, t_ns, &reading) == 0) {
		const struct lp_rotation rotation =
			lp_rotation_product(&reading.rotation, &teller->mount.rotation);

		/* Rates that were added up since the frame before make this one less certain. */
		const double variance = reading.variance + fmax(reading.walk - teller->walk, 0.0);

		stamp(frame, &rotation, sqrt(variance));
		stamp_position(frame, &reading, &teller->mount);
		teller->walk = reading.walk;
		teller->t_stamped_ns = lp_clock_ns();
	} else if (teller->track.count) {
		const uint64_t newest = (teller->track.count - 1) % LP_TRACK_POINTS;

		teller->t_unstamped_ns = lp_clock_ns();
		teller->behind_ms = (double)(t_ns - teller->track.points[newest].t_ns) / 1e6;
	}
}

/* ---------------------------------------------------------------- what is wrong with it */

void lp_orientation_judged(struct lp_orientation_teller *teller,
			   struct lp_estimate_orientation *orientation)
{
	if (orientation->world && teller->kind == LP_ORIENTATION_CLIENT)
		orientation->sigma_deg =
			hypotf(orientation->sigma_deg, (float)(teller->mount.sigma_rad / DEG));
	/* Frames of a client that has left meanwhile are still on their way. */
	const bool anybody = teller->kind != LP_ORIENTATION_CLIENT || teller->client;

	set_fault(teller, &teller->contradicted, CONTRADICTS,
		  orientation->left_out && anybody
			  ? "orientation: compare: what is told contradicts the pictures and is "
			    "left out — is the mount right (--mount), are times right?"
			  : NULL);
	set_fault(
		teller, &teller->misplaced, MISPLACED,
		orientation->places_left_out && anybody
			? "orientation: place: positions contradict the pictures and are left out "
			  "— are they metres, in the axes of the orientation?"
			: NULL);
}

/* What is missing, by what was to tell. */
static const char *silence(enum lp_orientation_kind kind)
{
	switch (kind) {
	case LP_ORIENTATION_CLIENT:
		return NO_POSE;
	case LP_ORIENTATION_FRAMES:
		return "orientation: receive: no frame has carried its orientation for a second — "
		       "only those of sim:, and of file: with poses, do";
	default:
		return NO_SAMPLE;
	}
}

void lp_orientation_tick(struct lp_orientation_teller *teller, int64_t now_ns)
{
	char text[160];

	if (teller->kind < LP_ORIENTATION_FRAMES)
		return;
	const bool silent = is_silent(teller, now_ns) && now_ns - teller->t_start_ns > SILENCE_NS;
	const bool late = !silent && teller->t_unstamped_ns &&
			  teller->t_unstamped_ns - teller->t_stamped_ns > SILENCE_NS &&
			  now_ns - teller->t_unstamped_ns < SILENCE_NS;

	set_fault(teller, &teller->silent, "orientation-silent",
		  silent ? silence(teller->kind) : NULL);
	(void)snprintf(text, sizeof(text),
		       "orientation: receive: poses come %.0f ms after the frames that they are "
		       "for, at most 50 ms are predicted — send them sooner",
		       teller->behind_ms);
	set_fault(teller, &teller->late, LATE, late ? text : NULL);
}
