/* SPDX-License-Identifier: Apache-2.0 */
/* How the camera turns: as predicted, corrected by what a frame shows. */
#include <math.h>
#include <string.h>

#include "light/math/grid.h"
#include "vision/camera/remap.h"
#include "vision/film/stokes_map.h"
#include "vision/imager_internal.h"
#include "vision/map/lookup.h"
#include "vision/turn/alignment.h"

/* Share of the cells that contradict what is known, from which on the camera may have turned. */
#define LEAST_CONTRADICTING 0.002F
/* The same of the light that the frame before showed changed: a lamp that moves before dark walls.
 */
#define LEAST_CHANGED 0.0005F
/* Nor is one of less than this share of the sphere. */
#define LEAST_COMPARED 0.0003F
/* Longer pauses are no motion that could be followed. */
#define MOST_ELAPSED_S 1.0
/* Chosen by hand, on tests/accuracy/live.py --orientation=sim. */
/* A camera that held still turns when the IMU says so by so many sigmas, and so much... */
#define CLEAR_SIGMAS 6.0
#define CLEAR_TURN (0.3 * M_PI / 180.0)
/* ...and of a camera that turns, both predictions are tried when they are so far apart. */
#define FAR_APART (0.75 * M_PI / 180.0)
/* A camera that seems to hold still is found to turn slowly when it has turned by so much against
 * the map. */
#define SLOW_TURN (3.0 * M_PI / 180.0)
/* Share of the sphere below which cameras see little. */
#define SEES_LITTLE 0.25F
/* One prediction fits better than the other when so much more of the picture agrees. */
#define CLEARLY_BETTER 0.03F

/* What the map shows was seen on the way of the last second. Seen from elsewhere it seems turned,
 * in a room where one side is nearer than the other: 1 sigma is the way over so much. */
#define MAP_LAG_S 1.0
#define PARALLAX_M 4.0

/* Where the camera may look, before and after it was compared with the map. */
struct attempt {
	struct lp_motion motion;
	struct lp_alignment_result result;
};

static bool compares(const struct attempt *attempt)
{
	return attempt->result.compared >= LEAST_COMPARED; /* else too dark, or too bright, to tell
							    */
}

/* The picture's own errors, and those of its way, as if alike about all axes. */
static void doubt_parallax(double sigma_rad, double information[3][3])
{
	const double mean = (information[0][0] + information[1][1] + information[2][2]) / 3.0;
	const double share = 1.0 / (1.0 + mean * sigma_rad * sigma_rad);

	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			information[a][b] *= share;
}

/* The alignment is loaded with picture and map. */
static void solve(struct lp_imager *imager, struct attempt *attempt)
{
	struct lp_motion *motion = &attempt->motion;
	double prior[3][3];

	lp_motion_prior(motion, prior);
	attempt->result = lp_alignment_solve(imager->alignment, &motion->rotation,
					     (const double(*)[3])prior, sqrt(1.0 / prior[0][0]));
	doubt_parallax(imager->turn.parallax_rad, attempt->result.information);
	if (compares(attempt) && attempt->result.agreement >= LP_LEAST_AGREEMENT)
		lp_motion_correct(motion, attempt->result.turn,
				  (const double(*)[3])attempt->result.information);
}

static void take(struct lp_imager *imager, const struct attempt *attempt)
{
	imager->turn.motion = attempt->motion;
	if (compares(attempt))
		imager->turn.agreement = attempt->result.agreement;
}

static double rate_of(const struct lp_motion *motion)
{
	const double *r = motion->rate;

	return sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
}

static double angle_between(const struct lp_rotation *a, const struct lp_rotation *b)
{
	const struct lp_rotation back = lp_rotation_inverse(a);
	const struct lp_rotation apart = lp_rotation_product(&back, b);
	double v[3];

	lp_rotation_vector(&apart, v);
	return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Whether the probe has gone so far that pictures alone do not tell whether it turns. */
static bool goes(const struct lp_imager *imager)
{
	return imager->turn.parallax_rad > CLEAR_TURN;
}

/* What the IMU told as a prediction; false: nothing that counts. Noise does not move a camera
 * that holds still; of one that goes, pictures do not tell whether it turns. */
static bool predict_by_imu(const struct lp_imager *imager, double elapsed_s,
			   struct lp_motion *motion)
{
	double turn[3], sigma_rad;

	if (!lp_imu_turn(&imager->turn.imu, &imager->turn.told, turn, &sigma_rad))
		return false;
	const double angle = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);

	if (!imager->turn.motion.turning && !goes(imager) &&
	    (angle < CLEAR_SIGMAS * sigma_rad || angle < CLEAR_TURN) &&
	    !lp_imu_turn_unseen(&imager->turn.imu, &imager->turn.told,
				&imager->turn.motion.rotation, turn, &sigma_rad))
		return false;
	*motion = imager->turn.motion;
	lp_motion_predict_turn(motion, elapsed_s, turn, sigma_rad);
	return true;
}

/* Whether the picture, where it was compared with the map, tells two rotations apart, as far as its
 * structure goes: before a bare wall it looks the same whichever way it turns. */
static bool tells_apart(const struct attempt *attempt, const struct lp_rotation *a,
			const struct lp_rotation *b)
{
	const struct lp_rotation back = lp_rotation_inverse(a);
	const struct lp_rotation apart = lp_rotation_product(&back, b);
	double v[3], chi2 = 0.0;

	if (!compares(attempt))
		return false;
	lp_rotation_vector(&apart, v);
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			chi2 += v[i] * attempt->result.information[i][j] * v[j];
	return chi2 > CLEAR_SIGMAS * CLEAR_SIGMAS;
}

/* Two predictions: the pictures decide which fits. Where they cannot, a camera that held still goes
 * on doing so if the frame agrees, and one that turns follows the IMU. */
static void choose(struct lp_imager *imager, const struct lp_motion *by_rate,
		   const struct lp_motion *by_imu)
{
	const bool turned = imager->turn.motion.turning || goes(imager);
	struct attempt imu = {.motion = *by_imu}, rate = {.motion = *by_rate};

	solve(imager, &imu);
	if (turned && angle_between(&by_rate->rotation, &by_imu->rotation) < FAR_APART) {
		take(imager, &imu);
		return;
	}
	solve(imager, &rate);
	/* The place that the IMU tells may be one that nobody has seen, where no picture
	 * contradicts it. So the picture is asked in the predicted place, too. */
	if (!tells_apart(&imu, &by_rate->rotation, &by_imu->rotation) &&
	    !tells_apart(&rate, &by_rate->rotation, &by_imu->rotation)) {
		take(imager, &imu);
		return;
	}
	const float more = turned ? CLEARLY_BETTER : -CLEARLY_BETTER;
	const bool is_rate = compares(&rate) && rate.result.agreement >= LP_LEAST_AGREEMENT &&
			     rate.result.agreement > imu.result.agreement + more;
	const struct attempt *const best = is_rate ? &rate : &imu;

	take(imager, best);
	if (compares(best) &&
	    lp_imu_is_apart(&by_imu->rotation, &imager->turn.motion.rotation,
			    hypot(hypot(imager->turn.told.sigma_rad, imager->turn.parallax_rad),
				  lp_motion_sigma_rad(&imager->turn.motion)),
			    rate_of(&imager->turn.motion)))
		lp_imu_contradict(&imager->turn.imu);
}

struct lp_shear lp_imager_shear(const struct lp_imager *imager)
{
	const struct lp_motion *motion = &imager->turn.motion;
	struct lp_shear shear = {.grid = imager->grid};

	if (!motion->turning || !imager->eye->remap || !(imager->time.read_out_s > 0.0F))
		return shear;
	shear.row_share = imager->eye->remap->row_share;
	for (int a = 0; a < 3; a++)
		shear.turn[a] = motion->rate[a] * (double)imager->time.read_out_s;
	return shear;
}

/* Find the map's cells in the frame of a turned camera. */
static void place_map(struct lp_imager *imager)
{
	const struct lp_rotation back = lp_rotation_inverse(&imager->turn.motion.rotation);
	const struct lp_shear shear = lp_imager_shear(imager);

	if (!lp_rotation_is_identity(&back))
		lp_lookup_set_sheared(imager->lookup, &back, &shear);
}

static bool contradicts(const struct lp_imager *imager, const struct lp_observation *seen)
{
	return imager->update.changed > LEAST_CHANGED ||
	       lp_radiance_map_contradicting(imager->map, seen) > LEAST_CONTRADICTING;
}

/* By the pictures alone. Where they hardly differ, noise must not move a camera that holds still.
 */
static void follow_by_pictures(struct lp_imager *imager, const struct lp_motion *by_rate,
			       bool differ, double elapsed_s)
{
	const double nothing[3][3] = {{0.0}};
	struct attempt attempt = {.motion = *by_rate};

	solve(imager, &attempt);
	lp_unseen_turn_looked(&imager->turn.unseen,
			      compares(&attempt) ? (const double(*)[3])attempt.result.information
						 : nothing,
			      elapsed_s);
	if (differ || angle_between(&by_rate->rotation, &attempt.motion.rotation) > SLOW_TURN)
		take(imager, &attempt);
	else
		imager->turn.motion = *by_rate;
}

bool lp_imager_sees_little(const struct lp_imager *imager)
{
	float seen = 0.0F;

	for (int k = 0; k < imager->eye_count; k++) {
		if (!imager->eyes[k].remap)
			return false;
		seen += imager->eyes[k].remap->seen_fraction;
	}
	return seen < SEES_LITTLE;
}

/* A camera that sees little at a time has nothing but what is told to lay its views beside each
 * other: a chain of pictures drifts. */
static void hold_to_told(struct lp_imager *imager)
{
	double pull[3], information[3][3];

	if (lp_imager_sees_little(imager) &&
	    lp_imu_pull(&imager->turn.imu, &imager->turn.told, &imager->turn.motion.rotation, pull,
			information))
		lp_motion_correct_by_landmarks(&imager->turn.motion, pull,
					       (const double(*)[3])information);
}

/* A camera that holds still is only looked at closer when the frame contradicts what is known, or a
 * IMU says clearly that it turns; and now and then. */
static void follow_turn(struct lp_imager *imager, double elapsed_s)
{
	struct lp_observation seen = lp_imager_residual(imager).seen;
	struct lp_motion by_rate = imager->turn.motion, by_imu;
	const bool told = predict_by_imu(imager, elapsed_s, &by_imu);

	lp_motion_predict(&by_rate, elapsed_s);
	if (imager->film.stokes && lp_rotation_is_identity(&imager->turn.motion.rotation))
		lp_stokes_map_see_through(imager->film.stokes, lp_imager_film(imager), &seen);
	if (imager->film.stokes)
		lp_imager_leave_out(imager, told ? &by_imu.rotation : &by_rate.rotation, &seen);
	const bool differ = told || imager->turn.motion.turning ||
			    !lp_rotation_is_identity(&imager->turn.motion.rotation) ||
			    contradicts(imager, &seen);
	const bool due =
		lp_unseen_turn_is_due(&imager->turn.unseen, elapsed_s) && !imager->turn.told.known;

	if (differ || due) {
		const struct lp_shear shear = lp_imager_shear(imager);

		lp_alignment_load(imager->alignment, imager->map, &seen, &shear);
		if (told)
			choose(imager, &by_rate, &by_imu);
		else
			follow_by_pictures(imager, &by_rate, differ, elapsed_s);
	} else {
		imager->turn.motion = by_rate;
	}
	if (imager->turn.motion.turning || imager->turn.told.known)
		imager->turn.unseen = (struct lp_unseen_turn){0};
	hold_to_told(imager);
	place_map(imager);
}

/* The newest frame against imager->turn.before. */
static void follow(struct lp_imager *imager)
{
	const double elapsed_s = (double)(imager->t_capture_ns - imager->turn.t_ns) / 1e9;
	const bool first = !imager->turn.t_ns || !imager->t_map_ns;

	imager->turn.agreement = 1.0F;
	imager->turn.elapsed_s = 0.0;
	imager->turn.t_ns = imager->t_capture_ns;
	if (!first && imager->options.follow_turns &&
	    (elapsed_s > 0.0 || lp_imager_is_late(imager, elapsed_s))) {
		imager->turn.elapsed_s = fmin(elapsed_s, MOST_ELAPSED_S);
		follow_turn(imager, imager->turn.elapsed_s);
	}
}

/* By the newest frame's place: the mean of the last second, and how far the probe is from it. */
static void find_parallax(struct lp_imager *imager)
{
	const struct lp_frame *frame = &imager->about;
	struct lp_follow *turn = &imager->turn;
	const double elapsed_s = (double)(imager->t_capture_ns - turn->t_ns) / 1e9;
	double way2 = 0.0;

	if (!imager->options.use_orientation || !(frame->position_sigma_m > 0.0F)) {
		turn->has_from = false;
		turn->parallax_rad = 0.0;
		return;
	}
	const double share = turn->has_from ? -expm1(-fmax(elapsed_s, 0.0) / MAP_LAG_S) : 1.0;

	for (int a = 0; a < 3; a++) {
		turn->from_m[a] += share * (frame->position_m[a] - turn->from_m[a]);
		way2 += (frame->position_m[a] - turn->from_m[a]) *
			(frame->position_m[a] - turn->from_m[a]);
	}
	turn->has_from = true;
	turn->parallax_rad = sqrt(way2) / PARALLAX_M;
}

void lp_imager_follow(struct lp_imager *imager)
{
	find_parallax(imager);
	if (imager->late_s > 0.0F) { /* the box has not turned since */
		imager->turn.agreement = 1.0F;
		imager->turn.elapsed_s = 0.0;
		return;
	}
	imager->turn.before = imager->turn.motion;
	imager->turn.t_before_ns = imager->turn.t_ns;
	lp_imu_take(&imager->turn.imu, &imager->turn.told_before, &imager->turn.told);
	imager->turn.told_before = imager->turn.told;
	follow(imager);
}

void lp_imager_follow_again(struct lp_imager *imager)
{
	imager->turn.motion = imager->turn.before;
	imager->turn.t_ns = imager->turn.t_before_ns;
	imager->turn.told_before = imager->turn.told;
	follow(imager);
}

void lp_imager_followed(struct lp_imager *imager)
{
	if (imager->late_s > 0.0F)
		return;
	lp_imu_compare(&imager->turn.imu, &imager->turn.told, &imager->turn.motion,
		       imager->turn.parallax_rad, fmax(imager->turn.elapsed_s, 0.0));
}

void lp_imager_correct_rotation(struct lp_imager *imager, const double pull[3],
				const double information[3][3])
{
	lp_motion_correct_by_landmarks(&imager->turn.motion, pull, information);
	place_map(imager);
}

struct lp_imager_turn lp_imager_turn(const struct lp_imager *imager)
{
	return (struct lp_imager_turn){
		.rate_deg_per_s = (float)(rate_of(&imager->turn.motion) * 180.0 / M_PI),
		.unseen_rate_deg_per_s = (float)(imager->turn.unseen.rate_rad_s * 180.0 / M_PI),
		.sigma_deg = (float)(lp_motion_sigma_rad(&imager->turn.motion) * 180.0 / M_PI),
		.time_sigma_s = imager->time.sigma_s,
		.goes = goes(imager)};
}

struct lp_imager_told lp_imager_told(const struct lp_imager *imager)
{
	const struct lp_imu_sample *sample = &imager->turn.told;
	const struct lp_frame *frame = &imager->about;
	const double late_rad =
		lp_imu_delay_sigma_rad(&imager->turn.imu, rate_of(&imager->turn.motion));
	struct lp_imager_told told = {.known = sample->known,
				      .rotation = sample->rotation,
				      .sigma_deg = (float)(hypot(sample->sigma_rad, late_rad) *
							   180.0 / M_PI),
				      .own_sigma_rad = sample->sigma_rad,
				      .late_sigma_s =
					      lp_imu_delay_sigma_rad(&imager->turn.imu, 1.0),
				      .left_out = imager->turn.imu.left_out,
				      .position_sigma_m = (double)frame->position_sigma_m,
				      .by = sample->by,
				      .t_ns = imager->time.middle_ns};

	lp_rotate(&sample->rotation, imager->turn.motion.rate, told.rate_rad_s);
	memcpy(told.position_m, frame->position_m, sizeof(told.position_m));
	return told;
}

bool lp_imager_rest(struct lp_imager *imager, struct lp_rotation *turn)
{
	if (!lp_motion_at_rest(&imager->turn.motion))
		return false;
	float in_map[LP_MAX_CAMERAS];

	for (int k = 0; k < imager->eye_count; k++)
		in_map[k] = lp_imager_scale_in_map(imager, &imager->eyes[k].gain);
	*turn = lp_rotation_inverse(&imager->turn.motion.rotation);
	lp_radiance_map_turn(imager->map, imager->lookup, &imager->turn.motion.rotation);
	for (int k = 0; k < imager->eye_count; k++) {
		lp_imager_turn_scale(imager, &imager->eyes[k].gain, in_map[k]);
		lp_stuck_turn(&imager->eyes[k].stuck, turn);
	}
	if (imager->film.stokes)
		lp_stokes_map_turn(imager->film.stokes, &imager->turn.motion.rotation);
	lp_imu_anchor(&imager->turn.imu, &imager->turn.motion.rotation);
	lp_motion_anchor(&imager->turn.motion);
	return true;
}
