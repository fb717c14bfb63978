/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <math.h>

#include "estimate/lamp_stage.h"
#include "include/light_estimate.h"

/* All fields are below; who adds one adds it there. */
_Static_assert(sizeof(struct lp_light) == 108, "each field of a listed light is compared");

static struct lp_remembered_lamp lamp(uint32_t id, bool wide, bool by_ring)
{
	return (struct lp_remembered_lamp){
		.id = id,
		.seen = true,
		.wide = wide,
		.lamp = {.direction = {0.0F, 0.6F, -0.8F},
			 .irradiance = {3.0F, 2.0F, 1.0F, 2.0F},
			 .solid_angle_sr = 0.01F,
			 .direction_sigma_deg = 0.1F,
			 .half_angle_deg = {9.0F, 4.0F},
			 .axis = {1.0F, 0.0F, 0.0F}},
		.strength_variance = 0.01F,
		.hidden = 0.2F,
		.recovered = {0.3F, 0.2F, 0.1F, 0.2F},
		.recovered_sigma = by_ring ? 0.1F : 0.0F,
		.recovered_colour_sigma = 0.05F,
		.image_probability = NAN,
		.existence = {.log_odds = 1.0F},
	};
}

#define SAME(field) assert_memory_equal(&a->field, &b->field, sizeof(a->field))

static void assert_same(const struct lp_light *a, const struct lp_light *b)
{
	SAME(id);
	SAME(direction);
	SAME(irradiance);
	SAME(angular_radius_deg);
	SAME(half_angle_deg);
	SAME(axis);
	SAME(direction_sigma_deg);
	SAME(irradiance_sigma);
	SAME(colour_sigma);
	SAME(distance_m);
	SAME(distance_sigma);
	SAME(nearest_m);
	SAME(hidden);
	SAME(flags);
	SAME(polarization.judged);
	SAME(polarization.known);
	SAME(polarization.reflection);
	SAME(polarization.dolp);
	SAME(polarization.aolp_deg);
	SAME(polarization.dolp_sigma);
	SAME(polarization.aolp_sigma_deg);
}

/* A place in the list held another light before: nothing of that is left in any field. */
static void test_nothing_of_another_light_is_left(void **state)
{
	static struct lp_lamp_stage stage;
	static struct lp_light_estimate first, second;

	(void)state;
	stage.memory.list[0] = lamp(1, false, false);
	stage.memory.list[1] = lamp(2, true, false);
	stage.memory.list[2] = lamp(3, false, true);
	memset(first.lights, 0x5A, sizeof(first.lights));
	memset(second.lights, 0x01, sizeof(second.lights));
	assert_int_equal(lp_lamp_stage_list(&stage, NULL, NULL, LP_MAX_LIGHTS, &first), 2);
	assert_int_equal(lp_lamp_stage_list(&stage, NULL, NULL, LP_MAX_LIGHTS, &second), 2);
	assert_int_equal(first.light_count, 3);
	assert_int_equal(first.area_count, 1);
	for (int k = 0; k < first.light_count; k++)
		assert_same(&first.lights[k], &second.lights[k]);
	assert_true(first.lights[2].half_angle_deg[0] == 9.0F && first.lights[0].axis[0] == 0.0F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_nothing_of_another_light_is_left),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
