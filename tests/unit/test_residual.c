/* SPDX-License-Identifier: Apache-2.0 */
/* What a frame tells of a cell's light. */
#include "vision/map/residual.h"

#include <math.h>
#include <stdint.h>

#include "include/luminance.h"
#include "lp_test.h"
#include "random_normal.h"
#include "vision/camera/camera.h"
#include "vision/camera/response.h"

#define CELLS 20000
#define NOISE 0.08F

static float radiance[CELLS][4];
static uint8_t flags[CELLS];

/* Cells of the same light, which differ by noise: all of them tell, or none. */
static void test_expected_light_chooses_without_a_preference(void **state)
{
	struct lp_camera *camera;
	struct lp_response response;
	float most = 0.0F;

	(void)state;
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	lp_response_init(&response, camera);
	lp_camera_destroy(camera);
	const struct lp_observation seen = {.radiance = (const float(*)[4])radiance,
					    .flags = flags,
					    .response = &response,
					    .scale = 1.0F,
					    .coded = true,
					    .code_variance = 0.25F};

	for (float light = 0.9F; light > 1e-3F; light *= 0.9F) {
		double expected = 0.0, own = 0.0;
		int count = 0, own_count = 0;

		for (int k = 0; k < CELLS; k++) {
			radiance[k][LP_LUMINANCE] = light * expf(NOISE * random_normal());
			const struct lp_log_light a =
				lp_log_light_expected(&seen, k, LP_LUMINANCE, light);
			const struct lp_log_light b = lp_log_light(&seen, k, LP_LUMINANCE);

			if (!isnan(a.log)) {
				expected += (double)(a.log - logf(light));
				count++;
			}
			if (!isnan(b.log)) {
				own += (double)(b.log - logf(light));
				own_count++;
			}
		}
		assert_true(count == 0 || count == CELLS);
		if (count)
			assert_float_equal(expected / count, 0.0, 0.003);
		if (own_count)
			most = fmaxf(most, (float)fabs(own / own_count));
	}
	assert_true(most > 0.03F); /* what a cell's own light would do near either end */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_expected_light_chooses_without_a_preference),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
