/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/ring/ring_steps.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "include/luminance.h"
#include "light/clipped/ring_fusion.h"
#include "light/math/rotation.h"
#include "light/send/model.h"

/* Chosen by hand (docs/maintainers/constants.md). */

/* Gain of the ratios' running mean, per frame; and where the sensor reads other than usual by more
 * than this, relative: a hand may be before it. */
#define RATIO_GAIN 0.1F
#define UNUSUAL 0.05F
#define UNUSUAL_GAIN 0.01F
/* Frames in a row that agree with the ring, or time, after which a step is over. */
#define AGREEING_FRAMES 3
#define LONGEST_NS (2 * LP_NS_PER_S)
/* A reading that is so much later than the frame says nothing of it. */
#define LONGEST_SINCE_FRAME_NS (LP_NS_PER_S / 2)
/* 1 sigma of what a ratio and the estimate's fine structure change in a few frames, relative. */
#define RATIO_SIGMA 0.005F
/* The same, for each factor e by which the light on a sensor is other than where its ratio was
 * learned, and for each radian by which it has turned since then: seats and cosine errors count
 * the more, the more the light grazes it. */
#define SHIFTED_SIGMA 0.15F
#define TURNED_SIGMA 0.1F
/* A camera at rest may have begun to turn by this since its last frame. */
#define TURN_SIGMA_RAD 0.01F
/* What is told again must differ by this, of the mean irradiance. */
#define WORTH_TELLING 0.01F
/* A lamp that is where another went is that one. */
#define SAME_PLACE_COSINE 0.9962F /* 5 degrees */
/* Less than this share of its light is left: it is not listed. */
#define OFF 0.02F

_Static_assert(LP_MAX_LIGHTS + LP_MAX_GONE + LP_MAX_CLIPPED_PARTS <= LP_MAX_STEP_SOURCES,
	       "all fit into one question");

static float dot(const float a[3], const float b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static bool is_usable(const struct lp_light_estimate *e)
{
	return !(e->flags & (LP_ESTIMATE_EXPOSURE_UNKNOWN | LP_ESTIMATE_NO_LIGHT));
}

static void look(const struct lp_rotation *to_anchor, float normals[LP_RING_SENSORS][3])
{
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		lp_ring_direction(k, normals[k]);
		lp_rotate_direction(to_anchor, normals[k]);
	}
}

/* Light without the listed lights, all orders. */
static void ambient_of(const struct lp_ring_steps *steps, float ambient[LP_SH_MAX_COUNT][3])
{
	double rest[LP_SH_MAX_COUNT][3];
	const struct lp_light_estimate *e = &steps->seen;

	for (int i = 0; i < LP_SH_MAX_COUNT; i++)
		for (int c = 0; c < 3; c++)
			rest[i][c] = steps->total[i][c];
	for (int j = 0; j < e->light_count; j++)
		lp_sh_add_lamp(LP_SH_MAX_ORDER, e->lights[j].direction, e->lights[j].irradiance,
			       0.0, -1.0, rest);
	for (int i = 0; i < LP_SH_MAX_COUNT; i++)
		for (int c = 0; c < 3; c++)
			ambient[i][c] = (float)rest[i][c];
}

/* Irradiance (luminance) that the newest frame's estimate brings on the sensors: lights exactly,
 * the rest by its coefficients. */
static void expect(const struct lp_ring_steps *steps, const float (*ambient)[3],
		   const float (*normals)[3], float expected[LP_RING_SENSORS])
{
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		float rgb[3];

		lp_sh_irradiance(LP_SH_MAX_ORDER, ambient, normals[k], rgb);
		expected[k] = fmaxf(lp_luminance(rgb), 0.0F);
		for (int j = 0; j < steps->seen.light_count; j++) {
			const struct lp_light *l = &steps->seen.lights[j];

			expected[k] += fmaxf(dot(l->direction, normals[k]), 0.0F) *
				       lp_luminance(l->irradiance);
		}
	}
}

static void add_source(struct lp_step_question *q, const float (*normals)[3],
		       const struct lp_light *light, bool is_on)
{
	struct lp_step_source *source = &q->sources[q->count++];

	for (int k = 0; k < LP_RING_SENSORS; k++)
		source->weight[k] = fmaxf(dot(light->direction, normals[k]), 0.0F);
	source->usual = lp_luminance(light->irradiance);
	source->now = is_on ? source->usual : 0.0F;
}

/* 1 sigma, relative, of sensor k's ratio in other light than that in which it was learned. */
static float ratio_sigma(const struct lp_ring_steps *steps, int k, const float normal[3],
			 float expected)
{
	const float shift = logf(expected / steps->ratio_at[k]);
	float turn[3];

	if (!isfinite(shift))
		return RATIO_SIGMA;
	for (int a = 0; a < 3; a++)
		turn[a] = TURNED_SIGMA * (normal[a] - steps->ratio_toward[k][a]);
	return sqrtf(RATIO_SIGMA * RATIO_SIGMA + SHIFTED_SIGMA * SHIFTED_SIGMA * shift * shift +
		     dot(turn, turn));
}

static void ask(const struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
		float turn_sigma_rad, const struct lp_ring_sample *now,
		float normals[LP_RING_SENSORS][3], struct lp_step_question *q)
{
	float ambient[LP_SH_MAX_COUNT][3], turned[LP_RING_SENSORS][3];

	*q = (struct lp_step_question){.turn_sigma_rad = hypotf(turn_sigma_rad, TURN_SIGMA_RAD)};
	ambient_of(steps, ambient);
	look(to_anchor, normals);
	expect(steps, (const float(*)[3])ambient, (const float(*)[3])normals, q->expected);
	for (int a = 0; a < 3; a++) {
		const double vector[3] = {a == 0 ? (double)TURN_SIGMA_RAD : 0.0,
					  a == 1 ? (double)TURN_SIGMA_RAD : 0.0,
					  a == 2 ? (double)TURN_SIGMA_RAD : 0.0};
		const struct lp_rotation turn = lp_rotation_of_vector(vector);

		memcpy(turned, normals, sizeof(turned));
		for (int k = 0; k < LP_RING_SENSORS; k++)
			lp_rotate_direction(&turn, turned[k]);
		expect(steps, (const float(*)[3])ambient, (const float(*)[3])turned, q->turn[a]);
		for (int k = 0; k < LP_RING_SENSORS; k++)
			q->turn[a][k] = (q->turn[a][k] - q->expected[k]) / TURN_SIGMA_RAD;
	}
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float read = now->illuminance_lux[k] / steps->ratio[k];

		q->change[k] = steps->ratio[k] > 0.0F ? read - q->expected[k] : NAN;
		q->sigma[k] = hypotf(now->noise_relative[k],
				     ratio_sigma(steps, k, normals[k], q->expected[k])) *
			      fmaxf(read, q->expected[k]);
	}
	for (int j = 0; j < steps->seen.light_count; j++)
		add_source(q, (const float(*)[3])normals, &steps->seen.lights[j], true);
	for (int j = 0; j < steps->gone_count; j++)
		add_source(q, (const float(*)[3])normals, &steps->gone[j], false);
	for (int j = 0; j < steps->part_count; j++)
		add_source(q, (const float(*)[3])normals, &steps->parts[j], true);
}

/* Of the light on all sensors that can be used. */
static float factor_of(const struct lp_step_question *q)
{
	float before = 0.0F, after = 0.0F;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (isfinite(q->change[k])) {
			before += q->expected[k];
			after += fmaxf(q->expected[k] + q->change[k], 0.0F);
		}
	return before > 0.0F ? after / before : 1.0F;
}

/* ---------------------------------------------------------------- the estimate */

static void scale_light(struct lp_light *light, float by)
{
	for (int c = 0; c < 3; c++)
		light->irradiance[c] *= by;
}

/* A light is other by `change` (luminance, variance), and so is the total. */
static void change_light(struct lp_light *light, float change, float variance, double (*total)[3])
{
	const float before = lp_luminance(light->irradiance);
	const float by = before > 0.0F ? fmaxf(before + change, 0.0F) / before : 0.0F;
	const float own =
		isnan(light->irradiance_sigma) ? 0.0F : light->irradiance_sigma * before * by;

	lp_sh_add_lamp(LP_SH_MAX_ORDER, light->direction, light->irradiance, 0.0, (double)by - 1.0,
		       total);
	scale_light(light, by);
	light->irradiance_sigma =
		before * by > 0.0F ? hypotf(own, sqrtf(variance)) / (before * by) : NAN;
	light->flags |= LP_LIGHT_RING;
}

static void list_again(const struct lp_light *gone, float strength, float variance,
		       struct lp_light_estimate *e, double (*total)[3])
{
	const int lamps = e->light_count - e->area_count;
	struct lp_light light = *gone;
	int at = lamps;

	scale_light(&light, strength / lp_luminance(gone->irradiance));
	light.irradiance_sigma = sqrtf(variance) / strength;
	light.flags = LP_LIGHT_RING;
	lp_sh_add_lamp(LP_SH_MAX_ORDER, light.direction, light.irradiance, 0.0, 1.0, total);
	if (e->light_count == LP_MAX_LIGHTS)
		return;
	while (at > 0 && lp_light_rank(&light) > lp_light_rank(&e->lights[at - 1]))
		at--;
	memmove(&e->lights[at + 1], &e->lights[at],
		(size_t)(e->light_count - at) * sizeof(e->lights[0]));
	e->lights[at] = light;
	e->light_count++;
}

/* Lamps that are off are not listed. */
static void drop_dark(const struct lp_light_estimate *before, struct lp_light_estimate *e)
{
	int count = 0, areas = 0;

	for (int j = 0; j < e->light_count; j++) {
		float full = 0.0F;

		for (int i = 0; i < before->light_count; i++)
			if (before->lights[i].id == e->lights[j].id)
				full = lp_luminance(before->lights[i].irradiance);
		if (lp_luminance(e->lights[j].irradiance) <= OFF * full)
			continue;
		areas += j >= e->light_count - e->area_count;
		e->lights[count++] = e->lights[j];
	}
	e->light_count = count;
	e->area_count = areas;
}

/* White light from all around, or from one side, has the colour of the mean light. */
static void change_ambient(const struct lp_step *step, double (*total)[3])
{
	const float mean[3] = {(float)total[0][0], (float)total[0][1], (float)total[0][2]};
	const double luminance = lp_luminance(mean);
	/* E = pi L00 Y00; and 2 pi / 3 L1m Y1m, with Y1m = sqrt(3 / 4 pi) (y, z, x) */
	const double constant = 1.0 / (M_PI * sqrt(1.0 / (4.0 * M_PI)));
	const double linear = 1.0 / (2.0 * M_PI / 3.0 * sqrt(3.0 / (4.0 * M_PI)));
	static const int axis_of[3] = {1, 2, 0};

	for (int c = 0; c < 3 && luminance > 0.0; c++) {
		const double tint = mean[c] / luminance;

		total[0][c] += fmax(constant * step->ambient[0] * tint, -total[0][c]);
		for (int m = 0; m < 3; m++)
			total[1 + m][c] += linear * step->ambient[1 + axis_of[m]] * tint;
	}
}

/* Adds what the step leaves unknown to e->relighting_sigma: root mean square over normals, of which
 * a lamp's variance counts 1/6 and that from all around counts in full. e->sh_total is set. */
static void add_sigma(const struct lp_step_question *q, const struct lp_step *step,
		      struct lp_light_estimate *e)
{
	double variance = step->ambient_variance, sensors = 0.0;
	const double mean = lp_model_mean_irradiance(e);

	for (int j = 0; j < q->count; j++)
		variance += step->variance[j] / 6.0;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		sensors += q->expected[k] / LP_RING_SENSORS;
	variance += step->all_variance * sensors * sensors;
	if (mean > 0.0)
		e->relighting_sigma = hypotf(e->relighting_sigma, (float)(sqrt(variance) / mean));
}

/* steps->seen, corrected by the step, becomes `e`. */
static void apply(const struct lp_ring_steps *steps, const struct lp_step_question *q,
		  const struct lp_step *step, struct lp_light_estimate *e)
{
	double total[LP_SH_MAX_COUNT][3];
	const int seen = steps->seen.light_count, parts = seen + steps->gone_count;

	*e = steps->seen;
	for (int i = 0; i < LP_SH_MAX_COUNT; i++)
		for (int c = 0; c < 3; c++)
			total[i][c] = steps->total[i][c] * (1.0 + (double)step->all);
	for (int j = 0; j < seen; j++) {
		const float spread = step->all_variance * q->sources[j].now * q->sources[j].now;

		scale_light(&e->lights[j], 1.0F + step->all);
		if (fabsf(step->change[j]) > OFF * q->sources[j].now || spread > 0.0F)
			change_light(&e->lights[j], step->change[j], step->variance[j] + spread,
				     total);
	}
	change_ambient(step, total);
	drop_dark(&steps->seen, e);
	for (int j = seen; j < parts; j++)
		if (step->change[j] > OFF * q->sources[j].usual)
			list_again(&steps->gone[j - seen], step->change[j], step->variance[j], e,
				   total);
	for (int j = parts; j < q->count; j++) {
		struct lp_light part = steps->parts[j - parts];

		scale_light(&part, 1.0F + step->all);
		change_light(&part, step->change[j], step->variance[j], total);
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e->sh_total[i][c] = (float)total[i][c];
	add_sigma(q, step, e);
	lp_model_predict((const double(*)[3])total, e);
}

/* ---------------------------------------------------------------- over time */

static void follow_ratio(struct lp_ring_steps *steps, int k, float ratio, const float normal[3],
			 float expected)
{
	const float usual = UNUSUAL + ratio_sigma(steps, k, normal, expected);
	const float off = fabsf(ratio / steps->ratio[k] - 1.0F); /* infinite at first */
	float gain = 1.0F;

	if (isfinite(off))
		gain = off > usual ? UNUSUAL_GAIN : RATIO_GAIN;
	steps->ratio[k] += gain * (ratio - steps->ratio[k]);
	steps->ratio_at[k] += gain * (expected - steps->ratio_at[k]);
	for (int a = 0; a < 3; a++)
		steps->ratio_toward[k][a] += gain * (normal[a] - steps->ratio_toward[k][a]);
}

static void learn_ratios(struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
			 const struct lp_ring_sample *then)
{
	float ambient[LP_SH_MAX_COUNT][3], normals[LP_RING_SENSORS][3], expected[LP_RING_SENSORS];

	ambient_of(steps, ambient);
	look(to_anchor, normals);
	expect(steps, (const float(*)[3])ambient, (const float(*)[3])normals, expected);
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float ratio = then->illuminance_lux[k] / expected[k];

		if (!isfinite(ratio) || ratio <= 0.0F)
			steps->ratio[k] = 0.0F;
		else
			follow_ratio(steps, k, ratio, normals[k], expected[k]);
	}
}

static bool is_at(const struct lp_light *a, const struct lp_light *b)
{
	return dot(a->direction, b->direction) > SAME_PLACE_COSINE;
}

static void forget_gone(struct lp_ring_steps *steps, int at)
{
	memmove(&steps->gone[at], &steps->gone[at + 1],
		(size_t)(--steps->gone_count - at) * sizeof(steps->gone[0]));
}

/* Lamps that the new estimate does not list any more are gone; those at their place are back. */
static void note_gone(struct lp_ring_steps *steps, const struct lp_light_estimate *e)
{
	for (int i = steps->gone_count - 1; i >= 0; i--)
		for (int j = 0; j < e->light_count; j++)
			if (is_at(&steps->gone[i], &e->lights[j])) {
				forget_gone(steps, i);
				break;
			}
	for (int i = 0; i < steps->seen.light_count; i++) {
		const struct lp_light *before = &steps->seen.lights[i];
		bool is_there = before->flags & LP_LIGHT_EXTENDED;

		for (int j = 0; j < e->light_count; j++)
			is_there |= is_at(before, &e->lights[j]);
		if (is_there || !(lp_luminance(before->irradiance) > 0.0F))
			continue;
		if (steps->gone_count == LP_MAX_GONE)
			forget_gone(steps, 0);
		steps->gone[steps->gone_count++] = *before;
	}
}

static enum lp_step_verdict judge(struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
				  float turn_sigma_rad, const struct lp_ring_sample *now,
				  struct lp_light_estimate *e)
{
	float normals[LP_RING_SENSORS][3];
	struct lp_step_question question;
	struct lp_step step;

	ask(steps, to_anchor, turn_sigma_rad, now, normals, &question);
	lp_ring_step(&question, (const float(*)[3])normals, &step);
	steps->factor = factor_of(&question);
	if (step.verdict == LP_STEP_FOUND)
		apply(steps, &question, &step, e);
	return step.verdict;
}

static void end(struct lp_ring_steps *steps)
{
	steps->pending = false;
	steps->agreeing = 0;
}

void lp_ring_steps_frame(struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
			 const struct lp_ring_sample *then, const struct lp_ring_sample *now,
			 const double (*total)[3], struct lp_light_estimate *estimate)
{
	note_gone(steps, estimate);
	steps->seen = *estimate;
	for (int i = 0; i < LP_SH_MAX_COUNT; i++)
		for (int c = 0; c < 3; c++)
			steps->total[i][c] = (float)total[i][c];
	if (steps->pending && (!now || now->t_ns - steps->t_step_ns > LONGEST_NS))
		end(steps);
	if (steps->pending) {
		const enum lp_step_verdict verdict = judge(steps, to_anchor, 0.0F, now, estimate);

		steps->agreeing = verdict == LP_STEP_NONE ? steps->agreeing + 1 : 0;
		if (steps->agreeing >= AGREEING_FRAMES)
			end(steps);
	} else if (then && is_usable(estimate)) {
		learn_ratios(steps, to_anchor, then);
	}
	steps->told = *estimate;
}

bool lp_ring_steps_reading(struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
			   float turn_sigma_rad, const struct lp_ring_sample *now)
{
	struct lp_light_estimate estimate = steps->seen;

	if (steps->seen.t_capture_ns == 0 || !is_usable(&steps->seen) ||
	    now->t_ns - steps->seen.t_capture_ns > LONGEST_SINCE_FRAME_NS)
		return false;
	const enum lp_step_verdict verdict =
		judge(steps, to_anchor, turn_sigma_rad, now, &estimate);

	if (verdict != LP_STEP_FOUND && !(steps->pending && verdict == LP_STEP_NONE))
		return false;
	if (lp_model_distance(&steps->told, &estimate) < WORTH_TELLING)
		return false;
	if (!steps->pending)
		steps->t_step_ns = now->t_ns;
	steps->pending = true;
	steps->agreeing = 0;
	steps->told = estimate;
	return true;
}

void lp_ring_steps_turn(struct lp_ring_steps *steps, const struct lp_rotation *turn)
{
	lp_model_turn(&steps->seen, turn, 0.0F);
	lp_model_turn(&steps->told, turn, 0.0F);
	lp_sh_rotate(turn, LP_SH_MAX_ORDER, steps->total);
	for (int i = 0; i < steps->gone_count; i++)
		lp_rotate_direction(turn, steps->gone[i].direction);
	for (int i = 0; i < steps->part_count; i++)
		lp_rotate_direction(turn, steps->parts[i].direction);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		lp_rotate_direction(turn, steps->ratio_toward[k]);
}
