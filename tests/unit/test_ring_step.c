/* SPDX-License-Identifier: Apache-2.0 */
/* Which lamp has been switched, by what nine sensors read. */
#include "light/ring/ring_step.h"

#include <math.h>
#include <stdlib.h>

#include "light/clipped/ring_fusion.h"
#include "lp_test.h"

#define NOISE 0.01F
#define PATTERN 0.04F
#define AMBIENT 100.0F /* irradiance on each sensor */
#define ROOMS 200

struct room {
	struct lp_step_question q;
	float normals[LP_RING_SENSORS][3];
	float directions[LP_MAX_STEP_SOURCES][3];
	unsigned int seed;
};

static float uniform(struct room *room)
{
	return (float)rand_r(&room->seed) / (float)RAND_MAX;
}

static float gauss(struct room *room)
{
	float sum = -6.0F;

	for (int i = 0; i < 12; i++)
		sum += uniform(room);
	return sum;
}

static void cosines(const struct room *room, const float direction[3], float weight[])
{
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		weight[k] = 0.0F;
		for (int a = 0; a < 3; a++)
			weight[k] += room->normals[k][a] * direction[a];
		weight[k] = fmaxf(weight[k], 0.0F);
	}
}

static void add_lamp(struct room *room, float azimuth_deg, float elevation_deg, float strength)
{
	const float rad = (float)M_PI / 180.0F;
	const float a = azimuth_deg * rad, e = elevation_deg * rad;
	struct lp_step_source *source = &room->q.sources[room->q.count];
	float *d = room->directions[room->q.count++];

	d[0] = cosf(e) * sinf(a);
	d[1] = sinf(e);
	d[2] = -cosf(e) * cosf(a);
	cosines(room, d, source->weight);
	source->now = source->usual = strength;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		room->q.expected[k] += strength * source->weight[k];
}

static void begin(struct room *room, unsigned int seed)
{
	*room = (struct room){.seed = seed * 2654435761U}; /* neighbours would draw alike */
	for (int i = 0; i < 8; i++)
		(void)uniform(room);
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		lp_ring_direction(k, room->normals[k]);
		room->q.expected[k] = AMBIENT;
	}
	room->q.turn_sigma_rad = 0.01F;
}

/* Of readings, and of what each sensor sees of a lamp: its seat and its cosine are not exact. */
static void add_noise(struct room *room)
{
	for (int k = 0; k < LP_RING_SENSORS; k++)
		room->q.change[k] *= 1.0F + PATTERN * gauss(room);
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float lux = room->q.expected[k] + room->q.change[k];

		room->q.sigma[k] = NOISE * fmaxf(lux, 1.0F);
		room->q.change[k] += room->q.sigma[k] * gauss(room);
	}
}

static void change_lamp(struct room *room, int lamp, float by)
{
	for (int k = 0; k < LP_RING_SENSORS; k++)
		room->q.change[k] += by * room->q.sources[lamp].weight[k];
}

static struct lp_step judge(const struct room *room)
{
	struct lp_step step;

	lp_ring_step(&room->q, (const float(*)[3])room->normals, &step);
	return step;
}

/* One of four lamps goes off, and with it the light that it threw on walls. Wherever the lamps are,
 * what is said lies within its sigma; where they are apart, it is the right one. */
static void test_a_lamp_that_goes_off_is_found(void **state)
{
	int within_3 = 0, clear = 0, right = 0, asked = 0;

	(void)state;
	for (unsigned int i = 0; i < ROOMS; i++) {
		struct room room;

		begin(&room, 1 + i);
		for (int lamp = 0; lamp < 4; lamp++)
			add_lamp(&room, 360.0F * uniform(&room), 70.0F * uniform(&room) - 10.0F,
				 100.0F + 400.0F * uniform(&room));
		change_lamp(&room, 1, -room.q.sources[1].now);
		const float indirect = 0.1F * room.q.sources[1].now * uniform(&room);

		for (int k = 0; k < LP_RING_SENSORS; k++)
			room.q.change[k] -= indirect;
		add_noise(&room);
		const struct lp_step step = judge(&room);

		if (step.verdict != LP_STEP_FOUND)
			continue;
		asked++;
		for (int lamp = 0; lamp < 4; lamp++) {
			const float truth = lamp == 1 ? -room.q.sources[1].now : 0.0F;
			const float sigma = hypotf(sqrtf(step.variance[lamp]), 2.0F);

			within_3 += fabsf(step.change[lamp] - truth) < 3.0F * sigma;
		}
		clear += sqrtf(step.variance[1]) < 0.15F * room.q.sources[1].now;
		right += fabsf(step.change[1] / room.q.sources[1].now + 1.0F) < 0.2F;
	}
	print_message("%d of %d steps seen, %d clear, %d right, %d of %d within 3 sigma\n", asked,
		      ROOMS, clear, right, within_3, 4 * asked);
	assert_true(asked > 0.95 * ROOMS);
	assert_true(right > 0.75 * asked);
	assert_true(within_3 > 0.97 * 4 * asked);
}

/* Lamps in nearly the same direction: shared, and said so. */
static void test_what_cannot_be_told_apart_is_shared(void **state)
{
	struct room room;

	(void)state;
	begin(&room, 7);
	add_lamp(&room, 40.0F, 30.0F, 300.0F);
	add_lamp(&room, 41.0F, 30.5F, 300.0F);
	add_lamp(&room, 200.0F, 30.0F, 300.0F);
	change_lamp(&room, 0, -300.0F);
	add_noise(&room);
	const struct lp_step step = judge(&room);

	assert_int_equal(step.verdict, LP_STEP_FOUND);
	assert_float_equal(step.change[0] + step.change[1], -300.0F, 45.0F);
	assert_true(fabsf(step.change[2]) < 20.0F);
	assert_true(sqrtf(step.variance[0]) > 50.0F);
}

/* A lamp that is off, at its old place. */
static void test_a_lamp_that_goes_on_again(void **state)
{
	struct room room;

	(void)state;
	begin(&room, 8);
	add_lamp(&room, 40.0F, 30.0F, 300.0F);
	add_lamp(&room, 200.0F, 30.0F, 0.0F);
	room.q.sources[1].usual = 250.0F;
	change_lamp(&room, 1, 250.0F);
	add_noise(&room);
	const struct lp_step step = judge(&room);

	assert_int_equal(step.verdict, LP_STEP_FOUND);
	assert_float_equal(step.change[1], 250.0F, 30.0F);
	assert_true(fabsf(step.change[0]) < 20.0F);
}

/* All lamps at one switch, or a cloud. */
static void test_all_light_at_once(void **state)
{
	struct room room;

	(void)state;
	begin(&room, 9);
	add_lamp(&room, 40.0F, 30.0F, 300.0F);
	add_lamp(&room, 150.0F, 10.0F, 200.0F);
	add_lamp(&room, 260.0F, 50.0F, 400.0F);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		room.q.change[k] = -0.7F * room.q.expected[k];
	add_noise(&room);
	const struct lp_step step = judge(&room);

	assert_int_equal(step.verdict, LP_STEP_FOUND);
	assert_float_equal(step.all, -0.7F, 0.05F);
}

/* A lamp that nobody knew: its light comes from about there. */
static void test_a_lamp_that_is_not_known(void **state)
{
	struct room room;
	float weight[LP_RING_SENSORS];
	const float direction[3] = {0.6F, 0.8F, 0.0F};

	(void)state;
	begin(&room, 10);
	add_lamp(&room, 300.0F, 0.0F, 300.0F);
	add_lamp(&room, 210.0F, -20.0F, 200.0F);
	cosines(&room, direction, weight);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		room.q.change[k] = 150.0F * weight[k];
	add_noise(&room);
	const struct lp_step step = judge(&room);

	/* light of one direction is no linear field: it is said that nothing explains it, or it
	 * comes from there */
	if (step.verdict == LP_STEP_FOUND)
		assert_true(step.ambient[1] * direction[0] + step.ambient[2] * direction[1] >
			    0.8F * sqrtf(step.ambient[1] * step.ambient[1] +
					 step.ambient[2] * step.ambient[2] +
					 step.ambient[3] * step.ambient[3]));
	else
		assert_int_equal(step.verdict, LP_STEP_UNCLEAR);
	assert_true(fabsf(step.change[0]) < 20.0F && fabsf(step.change[1]) < 20.0F);
}

/* A hand before one or two sensors, a head that turns, noise: no lamp is switched. */
static void test_what_is_no_step(void **state)
{
	int wrong = 0, shadows = 0;

	(void)state;
	for (unsigned int i = 0; i < ROOMS; i++) {
		struct room room;
		const int kind = (int)i % 3;

		begin(&room, 1000 + i);
		for (int lamp = 0; lamp < 3; lamp++)
			add_lamp(&room, 360.0F * uniform(&room), 60.0F * uniform(&room),
				 100.0F + 400.0F * uniform(&room));
		const int first = (int)(7.99F * uniform(&room));

		if (kind == 0) {
			room.q.change[first] = -0.8F * room.q.expected[first];
			if (i % 2)
				room.q.change[(first + 1) % 8] =
					-0.5F * room.q.expected[(first + 1) % 8];
		}
		for (int a = 0; a < 3; a++)
			for (int k = 0; k < LP_RING_SENSORS; k++)
				room.q.turn[a][k] = 100.0F * gauss(&room);
		for (int k = 0; kind == 1 && k < LP_RING_SENSORS; k++)
			room.q.change[k] = 0.1F * room.q.turn[1][k];
		if (kind == 1)
			room.q.turn_sigma_rad = 0.05F;
		add_noise(&room);
		const struct lp_step step = judge(&room);

		wrong += step.verdict == LP_STEP_FOUND;
		shadows += step.verdict == LP_STEP_SHADOW;
	}
	print_message("%d of %d taken for a step, %d shadows\n", wrong, ROOMS, shadows);
	assert_true(wrong < 0.02 * ROOMS);
	assert_true(shadows > 0.8 * ROOMS / 3);
}

/* Dead sensors are left out; with fewer than five nothing is said. */
static void test_dead_sensors(void **state)
{
	struct room room;

	(void)state;
	begin(&room, 11);
	add_lamp(&room, 40.0F, 30.0F, 300.0F);
	add_lamp(&room, 200.0F, 30.0F, 300.0F);
	change_lamp(&room, 0, -300.0F);
	add_noise(&room);
	room.q.change[3] = room.q.change[6] = NAN;
	struct lp_step step = judge(&room);

	assert_int_equal(step.verdict, LP_STEP_FOUND);
	assert_float_equal(step.change[0], -300.0F, 40.0F);
	room.q.change[0] = room.q.change[4] = room.q.change[8] = NAN;
	step = judge(&room);
	assert_int_equal(step.verdict, LP_STEP_NONE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_lamp_that_goes_off_is_found),
		cmocka_unit_test(test_what_cannot_be_told_apart_is_shared),
		cmocka_unit_test(test_a_lamp_that_goes_on_again),
		cmocka_unit_test(test_all_light_at_once),
		cmocka_unit_test(test_a_lamp_that_is_not_known),
		cmocka_unit_test(test_what_is_no_step),
		cmocka_unit_test(test_dead_sensors),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
