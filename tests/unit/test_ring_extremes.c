/* SPDX-License-Identifier: Apache-2.0 */
/* The ring of light sensors at its ends: darkness, 10^6 : 1 between sensors, explanations that look
 * alike, sigmas that are zero, infinite or none. */
#include <math.h>
#include <stdlib.h>

#include "figure.h"
#include "light/clipped/ring_fusion.h"
#include "light/math/rotation.h"
#include "light/ring/ring_alone.h"
#include "light/ring/ring_filter.h"
#include "light/ring/ring_step.h"
#include "random_normal.h"

#define DEG (M_PI / 180.0)
#define MANY 1000000

static const float odd[] = {NAN, INFINITY, -INFINITY, 0.0F, -0.0F, -1.0F, 1e-45F, 1e-38F, 3e38F};

static void normals_of(float normals[LP_RING_SENSORS][3])
{
	for (int k = 0; k < LP_RING_SENSORS; k++)
		lp_ring_direction(k, normals[k]);
}

static float facing(int sensor, const float direction[3])
{
	float n[3];

	lp_ring_direction(sensor, n);
	return fmaxf(n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2], 0.0F);
}

static void any_direction(float d[3])
{
	float length = 0.0F;

	for (int a = 0; a < 3; a++) {
		d[a] = random_normal();
		length += d[a] * d[a];
	}
	for (int a = 0; a < 3; a++)
		d[a] /= sqrtf(length);
}

static struct lp_ring_sample reading(const float direction[3], float lamp, float ambient)
{
	struct lp_ring_sample sample = {.t_ns = 1};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] = (float)M_PI * ambient + lamp * facing(k, direction);
		sample.sigma_relative[k] = 0.03F;
	}
	return sample;
}

/* ---------------------------------------------------------------- one lamp by the ring alone */

static double angle_deg(const float a[3], const float b[3])
{
	const double x = (double)a[1] * b[2] - (double)a[2] * b[1];
	const double y = (double)a[2] * b[0] - (double)a[0] * b[2];
	const double z = (double)a[0] * b[1] - (double)a[1] * b[0];

	return atan2(sqrt(x * x + y * y + z * z),
		     (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2]) /
	       DEG;
}

/* What is stated is finite, and a lamp that counts is uncertain by something. */
static void assert_sane(const struct lp_ring_alone *light)
{
	const float all[] = {light->ambient,	  light->lamp,	       light->ambient_sigma,
			     light->lamp_sigma,	  light->misfit,       light->direction_sigma_deg,
			     light->direction[0], light->direction[1], light->direction[2]};

	ASSERT_FINITE(all);
	assert_true(light->ambient >= 0.0F && light->lamp >= 0.0F);
	if (light->lamp > 0.0F && !(light->lamp_sigma > 0.0F && light->direction_sigma_deg > 0.0F))
		fail_msg("a lamp of %g is certain: sigma %g, %g degrees", (double)light->lamp,
			 (double)light->lamp_sigma, (double)light->direction_sigma_deg);
}

/* A lamp 10^6 times as bright as all else: over, beside and between the sensors. */
static void test_a_lamp_in_the_dark(void **state)
{
	static const float ratios[] = {0.0F, 1e-6F, 1e-3F};
	double worst = 0.0;

	(void)state;
	for (int trial = 0; trial < 150; trial++)
		for (int r = 0; r < 3; r++) {
			float d[3];
			struct lp_ring_alone light;

			any_direction(d);
			d[1] = fabsf(d[1]); /* no sensor looks down */
			if (trial < 9)
				lp_ring_direction(trial, d);
			const struct lp_ring_sample sample = reading(d, 1e6F, 1e6F * ratios[r]);

			assert_true(lp_ring_alone(&sample, &light));
			assert_sane(&light);
			const double off = angle_deg(light.direction, d);

			worst = fmax(worst, off / fmax((double)light.direction_sigma_deg, 0.1));
		}
	figure("ring alone", "a lamp, 1 : 1e3 … 1 : 0 around", "direction, sigmas", worst, 3.0);
}

/* Nothing faces a lamp: all alike, one sensor alone, all but one. */
static void test_what_tells_no_direction(void **state)
{
	(void)state;
	for (int lit = 0; lit < 1 << LP_RING_SENSORS; lit += lit < 16 ? 1 : 5) {
		struct lp_ring_sample sample = {.t_ns = 1};
		struct lp_ring_alone light;

		for (int k = 0; k < LP_RING_SENSORS; k++) {
			sample.illuminance_lux[k] = lit >> k & 1 ? 1e3F : 1e-3F;
			sample.sigma_relative[k] = 0.03F;
		}
		if (lp_ring_alone(&sample, &light))
			assert_sane(&light);
	}
	for (int e = 0; e <= 30; e += 5) {
		struct lp_ring_sample sample =
			reading((const float[]){0.0F, 1.0F, 0.0F}, 0.0F, powf(10.0F, (float)e));
		struct lp_ring_alone light;

		assert_true(lp_ring_alone(&sample, &light));
		assert_sane(&light);
		assert_true(light.ambient_sigma > 0.01F * light.ambient);
		assert_true(light.ambient_sigma < light.ambient);
	}
}

static void set_field(struct lp_ring_sample *sample, int field, int k, float value)
{
	float *const fields[] = {sample->illuminance_lux, sample->sigma_relative,
				 sample->noise_relative};

	fields[field][k] = value;
}

static bool is_number(float value, float least)
{
	return isfinite(value) && value >= least;
}

/* A reading whose sigma is not known, or infinite, tells nothing: as if it were not there. */
static void test_odd_readings_are_left_out(void **state)
{
	static const float direction[3] = {0.6F, 0.64F, -0.48F};
	struct lp_ring_sample sample = reading(direction, 100.0F, 1.0F);
	struct lp_ring_alone without, light;

	(void)state;
	sample.illuminance_lux[3] = NAN;
	assert_true(lp_ring_alone(&sample, &without));
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 3; field++) {
			sample = reading(direction, 100.0F, 1.0F);
			sample.illuminance_lux[3] = 0.0F;
			set_field(&sample, field, 3, odd[o]);
			assert_true(lp_ring_alone(&sample, &light));
			assert_sane(&light);
			if (!is_number(odd[o], field == 1 ? 1e-45F : 0.0F))
				assert_memory_equal(&light, &without, sizeof(light));
		}
}

/* ---------------------------------------------------------------- the filter */

static void test_the_filter_over_a_million_readings(void **state)
{
	struct lp_ring_filter filter = {0};
	struct lp_ring_sample light;
	double worst = 0.0;

	(void)state;
	for (int n = 0; n < MANY / LP_RING_SENSORS; n++) {
		/* switched by 10^6 : 1 every second, dark in between; with a lag, or none */
		const float lux = n / 100 % 3 == 0 ? 1e6F : n / 100 % 3 == 1 ? 1.0F : 0.0F;
		struct lp_ring_sample sample = {.t_ns = 1 + n * INT64_C(10000000)};

		for (int k = 0; k < LP_RING_SENSORS; k++) {
			sample.illuminance_lux[k] = lux;
			sample.noise_relative[k] = 0.01F;
			sample.rise_s[k] = 0.01F * (float)k;
			sample.fall_s[k] = 0.02F * (float)k;
		}
		(void)lp_ring_filter_update(&filter, &sample, &light);
		ASSERT_FINITE(light.illuminance_lux);
		ASSERT_FINITE(light.noise_relative);
		for (int k = 0; k < LP_RING_SENSORS; k++)
			assert_true(light.noise_relative[k] > 0.0F);
		if (n % 100 == 99 && lux > 0.0F)
			worst = fmax(worst, fabs((double)light.illuminance_lux[0] / lux - 1.0));
	}
	figure("ring filter", "1e6 readings, 1e6 : 1 : 0 by turns", "light, relative", worst, 0.02);
}

/* One reading that makes no sense must not be remembered as one. */
static void test_the_filter_forgets_nonsense(void **state)
{
	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 4; field++) {
			struct lp_ring_filter filter = {0};
			struct lp_ring_sample light;

			for (int n = 0; n < 60; n++) {
				struct lp_ring_sample sample = {.t_ns = 1 + n * INT64_C(10000000)};

				for (int k = 0; k < LP_RING_SENSORS; k++) {
					sample.illuminance_lux[k] = 100.0F;
					sample.noise_relative[k] = 0.01F;
					sample.rise_s[k] = sample.fall_s[k] = 0.03F;
				}
				if (n == 5 && field == 0)
					sample.illuminance_lux[2] = odd[o];
				if (n == 5 && field == 1)
					sample.noise_relative[2] = odd[o];
				if (n == 5 && field == 2)
					sample.rise_s[2] = sample.fall_s[2] = odd[o];
				if (n == 5 && field == 3)
					sample.t_ns = (int64_t)fminf(fmaxf(odd[o], 0.0F), 1e15F);
				(void)lp_ring_filter_update(&filter, &sample, &light);
			}
			if (!(fabs((double)light.illuminance_lux[2] - 100.0) < 1.0) ||
			    !isfinite(light.noise_relative[2]))
				fail_msg("field %d, %g: %g lux, noise %g", field, (double)odd[o],
					 (double)light.illuminance_lux[2],
					 (double)light.noise_relative[2]);
		}
}

/* ---------------------------------------------------------------- steps */

/* `count` lamps of which `alike` stand at one place; the first goes off. */
static struct lp_step_question a_lamp_goes_off(int count, int alike, float scale)
{
	struct lp_step_question q = {.count = count, .turn_sigma_rad = 1e-3F};
	float d[3];

	for (int i = 0; i < count; i++) {
		if (i == 0 || i >= alike)
			any_direction(d);
		d[1] = fabsf(d[1]);
		q.sources[i].now = q.sources[i].usual = scale;
		for (int k = 0; k < LP_RING_SENSORS; k++) {
			q.sources[i].weight[k] = facing(k, d);
			q.expected[k] += scale * q.sources[i].weight[k];
		}
	}
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		q.change[k] = -scale * q.sources[0].weight[k];
		q.sigma[k] = 0.01F * scale;
	}
	return q;
}

static void assert_step_is_finite(const struct lp_step *step, int count)
{
	assert_all_finite(step->change, count);
	assert_all_finite(step->variance, count);
	ASSERT_FINITE(step->ambient);
	assert_true(isfinite(step->ambient_variance) && isfinite(step->all) &&
		    isfinite(step->all_variance));
}

/* Lamps that no reading tells apart share the change, and say that none is certain. */
static void test_lamps_that_look_alike(void **state)
{
	float normals[LP_RING_SENSORS][3];
	double worst = 0.0, least_sigma = INFINITY;

	(void)state;
	normals_of(normals);
	for (int trial = 0; trial < 20; trial++)
		for (int e = -10; e <= 10; e += 5) {
			const float scale = powf(10.0F, (float)e);
			const struct lp_step_question q =
				a_lamp_goes_off(LP_MAX_STEP_SOURCES, LP_MAX_STEP_SOURCES, scale);
			struct lp_step step;
			double sum = 0.0;

			lp_ring_step(&q, (const float(*)[3])normals, &step);
			assert_step_is_finite(&step, q.count);
			if (step.verdict != LP_STEP_FOUND)
				continue;
			for (int i = 0; i < q.count; i++) {
				sum += step.change[i] / scale;
				least_sigma = fmin(least_sigma, sqrt(step.variance[i]) / scale);
			}
			worst = fmax(worst, fabs(sum + 1.0));
		}
	assert_true(least_sigma > 0.1); /* one of 32: sqrt(31) / 32 */
	figure("ring's steps", "32 lamps alike, one goes off, light 1e-10 … 1e10",
	       "sum of changes, relative", worst, 0.3);
}

static void test_odd_steps(void **state)
{
	float normals[LP_RING_SENSORS][3];

	(void)state;
	normals_of(normals);
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 6; field++) {
			struct lp_step_question q = a_lamp_goes_off(4, 1, 100.0F);
			struct lp_step step;

			for (int k = 0; k < (field == 5 ? LP_RING_SENSORS : 1); k++) {
				if (field == 0)
					q.change[k] = odd[o];
				if (field == 1 || field == 5)
					q.sigma[k] = odd[o];
			}
			if (field == 2)
				q.turn_sigma_rad = fmaxf(odd[o], 0.0F);
			if (field == 3)
				q.sources[2].now = q.sources[2].usual = fmaxf(odd[o], 0.0F);
			if (field == 4)
				memset(q.expected, 0, sizeof(q.expected));
			lp_ring_step(&q, (const float(*)[3])normals, &step);
			assert_step_is_finite(&step, q.count);
		}
}

/* ---------------------------------------------------------------- fusion */

/* Parts of which `alike` lie in one place; each truly hides `hidden`. */
static struct lp_ring_view view_of(int count, int alike, float hidden,
				   struct lp_ring_sample *sample)
{
	struct lp_ring_view view = {.count = count, .seen_sigma = 0.02F};
	float d[3];

	*sample = (struct lp_ring_sample){.t_ns = 1};
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		view.seen[k] = 1.0F;
		sample->sigma_relative[k] = 0.03F;
		sample->noise_relative[k] = 0.01F;
		sample->illuminance_lux[k] = 1.0F;
	}
	for (int j = 0; j < count; j++) {
		if (j == 0 || j >= alike)
			any_direction(d);
		d[1] = fabsf(d[1]);
		view.parts[j].bound = 0.1F;
		for (int k = 0; k < LP_RING_SENSORS; k++) {
			view.parts[j].weight[k] = facing(k, d);
			view.parts[j].spread[k] = 0.02F;
			sample->illuminance_lux[k] += hidden * view.parts[j].weight[k];
		}
	}
	return view;
}

static void assert_fusion_is_finite(const struct lp_ring_fusion *f)
{
	ASSERT_FINITE(f->excess);
	for (int j = 0; j < LP_MAX_CLIPPED_PARTS;
	     j++) /* infinite where no float holds its square */
		if (isnan(f->sigma[j]) || isnan(f->covariance[j][j]))
			fail_msg("sigma %g", (double)f->sigma[j]);
	if (!isfinite(f->misfit))
		fail_msg("misfit %g", (double)f->misfit);
	/* NAN: nobody gave it, and nothing is lit */
	if (lp_ring_counts(f->verdict) && !isnan(f->scale.lux_per_unit))
		assert_true(isfinite(f->scale.lux_per_unit) && isfinite(f->scale.sigma));
}

/* What is hidden in parts that look alike: its sum is known, not which of them holds it. */
static void test_parts_that_look_alike(void **state)
{
	static const struct lp_ring_scale known = {1.0F, 0.02F};
	double worst = 0.0, worst_part = 0.0;

	(void)state;
	for (int trial = 0; trial < 12; trial++)
		for (int e = -2; e <= 6; e += 2) {
			const float hidden = powf(10.0F, (float)e);
			struct lp_ring_sample sample;
			const struct lp_ring_view view =
				view_of(1 + trial % 4, LP_MAX_CLIPPED_PARTS, hidden, &sample);
			struct lp_ring_fusion fusion;
			double sum = 0.0, variance = 0.0;

			lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
			assert_fusion_is_finite(&fusion);
			if (!lp_ring_counts(fusion.verdict))
				continue;
			for (int i = 0; i < view.count; i++) {
				const double off = fabs((double)fusion.excess[i] - hidden);

				sum += fusion.excess[i];
				worst_part = fmax(worst_part, off / fusion.sigma[i]);
				for (int j = 0; j < view.count; j++)
					variance += fusion.covariance[i][j];
			}
			worst = fmax(worst, fabs(sum - hidden * view.count) / sqrt(variance));
		}
	figure("ring and camera", "parts alike, hidden light 1e-2 … 1e6 times what is seen",
	       "sum, sigmas", worst, 3.0);
	figure("ring and camera", "parts alike, hidden light 1e-2 … 1e6 times what is seen",
	       "each, sigmas", worst_part, 5.0);
}

static void test_odd_fusions(void **state)
{
	static const struct lp_ring_scale scales[] = {
		{1.0F, 0.02F}, {1.0F, 0.0F}, {NAN, NAN}, {1e-30F, 0.02F}, {1e30F, 0.02F}};

	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 7; field++)
			for (size_t s = 0; s < LP_COUNT(scales); s++) {
				struct lp_ring_sample sample;
				struct lp_ring_view view = view_of(3, 1, 10.0F, &sample);
				struct lp_ring_fusion fusion;
				const int last = field >= 4 ? LP_RING_SENSORS : 1;

				for (int k = 0; k < last; k++) {
					if (field != 3)
						set_field(&sample, field % 4, k, odd[o]);
				}
				if (field == 3)
					view.parts[1].bound = fmaxf(odd[o], 0.0F);
				lp_ring_fuse(&view, &sample, NULL, &scales[s], &fusion);
				if (fusion.verdict == LP_RING_NO_READING)
					continue;
				assert_fusion_is_finite(&fusion);
			}
}

/* Nothing is seen, and nothing is read. */
static void test_all_dark(void **state)
{
	static const struct lp_ring_scale scales[] = {{1.0F, 0.02F}, {NAN, NAN}};

	(void)state;
	for (int s = 0; s < 2; s++)
		for (int count = 0; count <= LP_MAX_CLIPPED_PARTS; count += 4)
			for (int dark = 0; dark < 3; dark++) {
				struct lp_ring_sample sample;
				struct lp_ring_view view = view_of(count, 1, 0.0F, &sample);
				struct lp_ring_fusion fusion;
				struct lp_ring_alone light;

				for (int k = 0; k < LP_RING_SENSORS; k++) {
					if (dark != 1)
						sample.illuminance_lux[k] = 0.0F;
					if (dark != 2)
						view.seen[k] = 0.0F;
				}
				lp_ring_fuse(&view, &sample, NULL, &scales[s], &fusion);
				assert_fusion_is_finite(&fusion);
				if (dark == 0)
					for (int j = 0; j < count; j++)
						assert_true(fusion.excess[j] < 1e-3F);
				if (dark != 1)
					assert_false(lp_ring_alone(&sample, &light));
			}
}

/* Parts opposite each other, of which nothing is known: the light is no better known for it. */
static void test_an_infinite_sigma_stays_infinite(void **state)
{
	static const struct lp_clipped_parts parts = {.count = 2,
						      .list = {{.direction = {1.0F, 0.0F, 0.0F}},
							       {.direction = {-1.0F, 0.0F, 0.0F}}}};
	struct lp_ring_fusion fusion = {0};

	(void)state;
	for (int i = 0; i < 2; i++)
		for (int j = 0; j < 2; j++)
			fusion.covariance[i][j] = INFINITY;
	assert_true(isinf(lp_ring_variance(&fusion, &parts)));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_lamp_in_the_dark),
		cmocka_unit_test(test_what_tells_no_direction),
		cmocka_unit_test(test_odd_readings_are_left_out),
		cmocka_unit_test(test_the_filter_over_a_million_readings),
		cmocka_unit_test(test_the_filter_forgets_nonsense),
		cmocka_unit_test(test_lamps_that_look_alike),
		cmocka_unit_test(test_odd_steps),
		cmocka_unit_test(test_parts_that_look_alike),
		cmocka_unit_test(test_odd_fusions),
		cmocka_unit_test(test_an_infinite_sigma_stays_infinite),
		cmocka_unit_test(test_all_dark),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
