/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/wheel/timed.h"

#include <errno.h>
#include <math.h>
#include <stddef.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/param.h"

#define BELOW_DEG 9.0F	     /* the way up begins so far below the comb */
#define MARGIN_DEG 1.0F	     /* a target closer to an edge may lie on either side of it */
#define DRIFT_DEG 2.0F	     /* edges after the first, from where that one says */
#define TRAVEL_DEG 270.0F    /* from wherever the wheel was */
#define SLOWEST_DEG_S 120.0F /* of a servo that is not ramped */
#define FIRST_AGAIN_NS (2 * LP_NS_PER_S)
#define LAST_AGAIN_NS (60 * LP_NS_PER_S)
#define MOST_TRIES 3

static const struct lp_param list[] = {
	{"servo_zero_us", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, servo_zero_us),
	 .initial = "800", .min = 300, .max = 2700,
	 .help = "width of the pulse at 0 degrees of the wheel"},
	{"servo_us_per_deg", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, servo_us_per_deg),
	 .initial = "7.407", .min = -20, .max = 20,
	 .help = "change of the pulse per degree of the wheel"},
	{"servo_min_us", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, servo_min_us),
	 .initial = "500", .min = 300, .max = 2700,
	 .help = "limit of the servo: no pulse is shorter"},
	{"servo_max_us", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, servo_max_us),
	 .initial = "2500", .min = 300, .max = 2700,
	 .help = "limit of the servo: no pulse is longer"},
	{"slew_deg_s", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, slew_deg_s),
	 .initial = "90", .min = 10, .max = 400,
	 .help = "speed of the wheel that the pulses command"},
	{"slew_physical_deg_s", LP_PARAM_FLOAT,
	 offsetof(struct lp_timed_params, slew_physical_deg_s), .initial = "900", .min = 50,
	 .max = 5000, .help = "fastest possible speed; what is faster is an error of the sensor"},
	{"lag_ms", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, lag_ms), .initial = "40",
	 .max = 500, .help = "delay of the wheel behind the pulses"},
	{"settle_ms", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, settle_ms), .initial = "200",
	 .min = 20, .max = 5000, .help = "time at rest after which the wheel counts as settled"},
	{"hold_s", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, hold_s), .initial = "10",
	 .min = 0.1, .max = 60, .help = "time after settling until the servo is switched off"},
	{"first_deg", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, first_deg),
	 .initial = "-16.5", .min = -60, .max = 60, .help = "angle of the first edge of the comb"},
	{"pitch_deg", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, pitch_deg), .initial = "6",
	 .min = 2, .max = 60, .help = "distance between two edges"},
	{"edges", LP_PARAM_INT, offsetof(struct lp_timed_params, edges), .initial = "34", .min = 2,
	 .max = 200, .help = "number of edges of the comb: two for each tooth"},
	{"edge_error_deg", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, edge_error_deg),
	 .initial = "0.3", .max = 5, .help = "position error of the comb's edges"},
	{"tolerance_deg", LP_PARAM_FLOAT, offsetof(struct lp_timed_params, tolerance_deg),
	 .initial = "6", .min = 1, .max = 20,
	 .help = "largest difference allowed between commanded angle and comb"},
};
const struct lp_params lp_timed_keys = LP_PARAMS(list);

/* ---------------------------------------------------------------- geometry */

static float edge_deg(const struct lp_timed *timed, int edge)
{
	return timed->params.first_deg + (float)edge * timed->params.pitch_deg;
}

/* Edges that lie below an angle. */
static int edges_below(const struct lp_timed *timed, float angle_deg)
{
	const float above = angle_deg - timed->params.first_deg;
	const int count = (int)ceilf(above / timed->params.pitch_deg);

	return count < 0 ? 0 : count > timed->params.edges ? timed->params.edges : count;
}

static float low_deg(const struct lp_timed *timed)
{
	return timed->params.first_deg - BELOW_DEG;
}

static float seconds(int64_t from_ns, int64_t to_ns)
{
	return (float)(to_ns - from_ns) / 1e9F;
}

static float lag_s(const struct lp_timed *timed)
{
	return timed->params.lag_ms / 1000.0F;
}

/* The command as it is so long after the step began; the servo's angle, not the wheel's. */
static float command_deg(const struct lp_timed *timed, float elapsed_s)
{
	const float gone_deg = timed->params.slew_deg_s * fmaxf(elapsed_s, 0);

	if (timed->step == LP_TIMED_UP)
		return fminf(low_deg(timed) + gone_deg, timed->target_deg + timed->offset_deg);
	if (timed->step == LP_TIMED_DOWN) /* a servo whose place nobody knows cannot be ramped */
		return timed->homed ? fmaxf(timed->from_deg - gone_deg, low_deg(timed))
				    : low_deg(timed);
	return timed->target_deg + timed->offset_deg;
}

static float unlimited_pulse_us(const struct lp_timed *timed, float angle_deg)
{
	return timed->params.servo_zero_us + timed->params.servo_us_per_deg * angle_deg;
}

/* ---------------------------------------------------------------- steps */

static void enter(struct lp_timed *timed, enum lp_timed_step step, int64_t now_ns)
{
	timed->step = step;
	timed->t_step_ns = now_ns;
}

static void fail(struct lp_timed *timed, const char *fault, const char *next_step, int64_t now_ns)
{
	if (!timed->fault) { /* what later tries end with says less */
		timed->fault = fault;
		timed->next_step = next_step;
	}
	timed->homed = false;
	timed->stopped = timed->tries >= MOST_TRIES;
	enter(timed, LP_TIMED_FAULT, now_ns);
	timed->t_again_ns = now_ns + lp_backoff_next_ns(&timed->again);
}

static void go_down(struct lp_timed *timed, int64_t now_ns)
{
	timed->from_deg = timed->target_deg + timed->offset_deg;
	enter(timed, LP_TIMED_DOWN, now_ns);
}

bool lp_timed_check(const struct lp_timed_params *params, const char *object)
{
	if (params->servo_min_us < params->servo_max_us)
		return true;
	lp_error(object, "servo_min_us", "%g is not below servo_max_us=%g",
		 (double)params->servo_min_us, (double)params->servo_max_us);
	return false;
}

const char *lp_timed_step_name(enum lp_timed_step step)
{
	static const char *const names[] = {[LP_TIMED_IDLE] = "idle",
					    [LP_TIMED_DOWN] = "down, below the comb",
					    [LP_TIMED_UP] = "up, edges count",
					    [LP_TIMED_REST] = "at rest",
					    [LP_TIMED_FAULT] = "fault"};

	return names[step];
}

void lp_timed_init(struct lp_timed *timed)
{
	timed->step = LP_TIMED_IDLE;
	timed->target_deg = NAN;
	timed->again = (struct lp_backoff){.first_ns = FIRST_AGAIN_NS, .longest_ns = LAST_AGAIN_NS};
}

int lp_timed_move(struct lp_timed *timed, float target_deg, int64_t now_ns, const char **reason)
{
	const int below = edges_below(timed, target_deg);

	const float pulse_us = unlimited_pulse_us(timed, target_deg);

	*reason = "beyond the servo's pulses";
	if (pulse_us < timed->params.servo_min_us || pulse_us > timed->params.servo_max_us)
		return -ERANGE;
	*reason = "beyond the comb";
	if (below < 2 || below >= timed->params.edges)
		return -ERANGE;
	*reason = "too close to an edge of the comb";
	if (target_deg - edge_deg(timed, below - 1) < MARGIN_DEG ||
	    edge_deg(timed, below) - target_deg < MARGIN_DEG)
		return -ERANGE;
	if (timed->step == LP_TIMED_REST || timed->step == LP_TIMED_UP)
		go_down(timed, now_ns);
	timed->target_deg = target_deg;
	return 0;
}

void lp_timed_forget(struct lp_timed *timed, int64_t now_ns)
{
	timed->homed = false;
	timed->offset_deg = 0;
	enter(timed, timed->fault ? LP_TIMED_FAULT : LP_TIMED_IDLE, now_ns);
}

void lp_timed_edge(struct lp_timed *timed, int64_t t_ns)
{
	const struct lp_timed_params *p = &timed->params;
	const float apart_s = seconds(timed->t_edge_ns, t_ns);

	timed->t_edge_ns = t_ns;
	if (timed->step == LP_TIMED_REST) {
		fail(timed, "WHEEL_SLIP",
		     "the wheel moved by itself: check horn and gear; is it touched?", t_ns);
		return;
	}
	if (timed->step != LP_TIMED_UP)
		return;
	const float at_deg = command_deg(timed, seconds(timed->t_step_ns, t_ns) - lag_s(timed));
	const float off_deg = at_deg - edge_deg(timed, timed->edges);
	const bool first = timed->edges++ == 0;

	if (!first && apart_s < (p->pitch_deg - 2 * p->edge_error_deg) / p->slew_physical_deg_s)
		fail(timed, "WHEEL_TOO_FAST",
		     "the sensor reports an impossible speed: check wiring; stray light?", t_ns);
	else if (off_deg - (first ? 0 : timed->offset_deg) > (first ? p->tolerance_deg : DRIFT_DEG))
		fail(timed, "WHEEL_SLOW",
		     "the wheel follows too slowly: check for friction, and the supply", t_ns);
	else if (off_deg - (first ? 0 : timed->offset_deg) <
		 -(first ? p->tolerance_deg : DRIFT_DEG))
		fail(timed, "WHEEL_SLIP", "an edge came too early: check horn, gear and cable",
		     t_ns);
	else if (first)
		timed->offset_deg = off_deg;
}

/* All the way has been commanded, and time has passed: is the wheel there? */
static void arrive(struct lp_timed *timed, int64_t now_ns, bool sensor_on)
{
	const int wanted = edges_below(timed, timed->target_deg);

	if (timed->edges == 0 && sensor_on) {
		fail(timed, "INDEX_ALWAYS",
		     "the sensor always sees a tooth: plug or dirt? does the wheel turn?", now_ns);
	} else if (timed->edges == 0) {
		fail(timed, "INDEX_NEVER",
		     "homing saw no tooth: check the plug; does the wheel turn?", now_ns);
	} else if (timed->edges < wanted) {
		fail(timed, "WHEEL_STUCK",
		     "the wheel does not follow: free it, and check the supply", now_ns);
	} else if (timed->edges > wanted) {
		fail(timed, "WHEEL_SLIP", "the wheel went too far: check horn, gear and cable",
		     now_ns);
	} else {
		timed->homed = true;
		timed->fault = NULL;
		timed->tries = 0;
		lp_backoff_reset(&timed->again);
		enter(timed, LP_TIMED_REST, now_ns);
	}
}

void lp_timed_tick(struct lp_timed *timed, int64_t now_ns, bool sensor_on)
{
	const struct lp_timed_params *p = &timed->params;
	const float elapsed_s = seconds(timed->t_step_ns, now_ns);
	const float rest_s = lag_s(timed) + p->settle_ms / 1000.0F;

	if (isnan(timed->target_deg))
		return;
	if (timed->step == LP_TIMED_IDLE ||
	    (timed->step == LP_TIMED_FAULT && !timed->stopped && now_ns >= timed->t_again_ns)) {
		timed->tries += timed->step == LP_TIMED_FAULT;
		timed->offset_deg = 0;
		go_down(timed, now_ns);
	} else if (timed->step == LP_TIMED_DOWN) {
		const float way_deg = timed->homed ? timed->from_deg - low_deg(timed) : TRAVEL_DEG;
		const float pace = timed->homed ? p->slew_deg_s : SLOWEST_DEG_S;

		if (elapsed_s < way_deg / pace + rest_s)
			return;
		timed->edges = 0;
		timed->offset_deg = 0;
		enter(timed, LP_TIMED_UP, now_ns);
	} else if (timed->step == LP_TIMED_UP) {
		const float way_deg = timed->target_deg + timed->offset_deg - low_deg(timed);

		if (elapsed_s >= way_deg / p->slew_deg_s + rest_s)
			arrive(timed, now_ns, sensor_on);
	}
}

float lp_timed_pulse_us(const struct lp_timed *timed, int64_t now_ns)
{
	const float elapsed_s = seconds(timed->t_step_ns, now_ns);

	if (timed->step == LP_TIMED_IDLE || timed->step == LP_TIMED_FAULT ||
	    (timed->step == LP_TIMED_REST && elapsed_s > timed->params.hold_s))
		return 0;
	return fminf(fmaxf(unlimited_pulse_us(timed, command_deg(timed, elapsed_s)),
			   timed->params.servo_min_us),
		     timed->params.servo_max_us);
}

void lp_timed_state(const struct lp_timed *timed, int64_t now_ns, struct lp_wheel_state *state)
{
	*state = (struct lp_wheel_state){.phase = timed->step == LP_TIMED_IDLE	  ? LP_WHEEL_UNKNOWN
						  : timed->step == LP_TIMED_REST  ? LP_WHEEL_SETTLED
						  : timed->step == LP_TIMED_FAULT ? LP_WHEEL_FAULT
						  : timed->homed		  ? LP_WHEEL_MOVING
										  : LP_WHEEL_HOMING,
					 .commanded_deg = timed->target_deg,
					 .measured_deg = NAN,
					 .sigma_deg = NAN,
					 .t_phase_ns = timed->t_step_ns,
					 .t_seen_ns = now_ns,
					 .clock_sigma_us = NAN};
	if (timed->step != LP_TIMED_REST)
		return;
	const int below = edges_below(timed, timed->target_deg);
	const float under_deg = timed->target_deg - edge_deg(timed, below - 1);
	const float over_deg = edge_deg(timed, below) - timed->target_deg;

	state->measured_deg = timed->target_deg;
	state->sigma_deg = (fmaxf(under_deg, over_deg) + timed->params.edge_error_deg) / 3;
}
