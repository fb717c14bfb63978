/* SPDX-License-Identifier: Apache-2.0 */
/* ptp: what is said to a THETA and what is heard from it; its moods, and what is left on it. What
 * all sources have in common is in test_source_contract.c. */
#include "lp_test.h"

#include <math.h>

#include "app/backends.h"
#include "base/clock.h"
#include "drivers/source/photo.h"
#include "drivers/source/ptp/data.h"
#include "fake_theta.h"
#include "include/frame.h"
#include "include/source.h"
#include "loop_test.h"

#define PATIENCE_NS (60 * LP_NS_PER_S) /* the machine may be busy */

static struct lp_loop *loop;
static struct lp_source *source;

static struct {
	enum lp_source_state state;
	char reason[512];
	int frames;
	float exposures_us[64];
	struct lp_frame last;
} heard;

static void on_frame(void *context, struct lp_frame *frame)
{
	(void)context;
	heard.exposures_us[heard.frames++ % 64] = lp_frame_exposure_us(frame);
	heard.last = *frame;
	lp_frame_release(frame);
}

static void on_corrupt(void *context)
{
	(void)context;
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	(void)context;
	heard.state = state;
	(void)snprintf(heard.reason, sizeof(heard.reason), "%s", reason);
}

#define UNTIL(condition)                                                                      \
	do {                                                                                  \
		const int64_t end_ns = lp_clock_ns() + PATIENCE_NS;                           \
		while (!(condition)) {                                                        \
			if (lp_clock_ns() > end_ns)                                           \
				fail_msg("not seen: %s; heard %s", #condition, heard.reason); \
			(void)loop_turn(loop, 20);                                            \
		}                                                                             \
	} while (0)

static void create(const char *uri)
{
	const struct lp_source_host host = {.loop = loop,
					    .frame = on_frame,
					    .corrupt = on_corrupt,
					    .state = on_state};

	memset(&heard, 0, sizeof(heard));
	assert_int_equal(lp_source_open(uri, &host, &source), 0);
	assert_int_equal(source->ops->start(source), 0);
}

static void destroy(void)
{
	if (source)
		source->ops->destroy(source);
	source = NULL;
}

static void send_stills(int count)
{
	for (int i = 0; i < count; i++)
		assert_true(fake_theta_send(false));
}

static int setup(void **state)
{
	(void)state;
	fake_theta_init();
	fake_theta_plug();
	return lp_loop_create(&loop);
}

static int teardown(void **state)
{
	(void)state;
	destroy();
	lp_loop_destroy(loop);
	return 0;
}

/* ---------------------------------------------------------------- data sets */

/* Two units of 16 bytes for an exposure, as RICOH lays them out (property 0xD812). */
static void test_brackets_are_laid_out_as_published(void **state)
{
	static const uint64_t shutters[] = {1ULL << 32 | 16000, 10ULL << 32 | 25};
	static const uint8_t x[] = {
		4, 0, 0,  0,						      /* units */
		0, 0, 50, 0, 0x80, 0x3e, 0, 0, 1,  0, 0, 0, 0,	  0,	1, 0, /* 1/16000 s */
		0, 0, 0,  0, 0,	   0,	 0, 0, 0,  0, 0, 0, 0x88, 0x13, 0, 0, /* 5000 K */
		0, 0, 50, 0, 25,   0,	 0, 0, 10, 0, 0, 0, 0,	  0,	1, 0, /* 10/25 s */
		0, 0, 0,  0, 0,	   0,	 0, 0, 0,  0, 0, 0, 0x88, 0x13, 0, 0};
	struct lp_ptp_bracket bracket = {.family = LP_PTP_THETA_X,
					 .count = 2,
					 .shutters = shutters,
					 .iso = 50,
					 .kelvins = 5000};
	uint8_t data[LP_PTP_BRACKET_BYTES(2)];

	(void)state;
	lp_ptp_bracket_write(&bracket, data);
	assert_int_equal(sizeof(data), sizeof(x));
	assert_memory_equal(data, x, sizeof(x));
	/* a Z1 has an aperture, and says that its white balance is in kelvins */
	bracket.family = LP_PTP_THETA_Z1;
	lp_ptp_bracket_write(&bracket, data);
	assert_int_equal(data[4 + 12], 3);
	assert_memory_equal(data + 4 + 30, "\x07\x80", 2);
	bracket.family = LP_PTP_THETA_V;
	lp_ptp_bracket_write(&bracket, data);
	assert_int_equal(data[4 + 12], 0);
	assert_memory_equal(data + 4 + 30, "\x07\x80", 2);
}

static void test_exposures_are_of_the_list(void **state)
{
	const struct lp_ptp_values list = {.values = {0, 1ULL << 32 | 16000, 1ULL << 32 | 12800,
						      1ULL << 32 | 1000, 1ULL << 32 | 60,
						      60ULL << 32 | 1, 1ULL << 32},
					   .count = 7};
	uint64_t chosen[4];

	(void)state;
	assert_int_equal(lp_ptp_choose(&list, 0, 4, 3, chosen), 3);
	assert_float_equal(lp_ptp_shutter_us(chosen[0]), 62.5, 1e-3);
	assert_float_equal(lp_ptp_shutter_us(chosen[1]), 1000, 1e-3);
	assert_float_equal(lp_ptp_shutter_us(chosen[2]), 1e6 / 60, 1);
	/* never one twice */
	assert_int_equal(lp_ptp_choose(&list, 60, 0.1F, 4, chosen), 4);
	for (int i = 1; i < 4; i++)
		assert_true(lp_ptp_shutter_us(chosen[i]) > lp_ptp_shutter_us(chosen[i - 1]));
	/* and none beyond the longest */
	assert_int_equal(lp_ptp_choose(&list, 1e6F, 8, 3, chosen), 1);
	assert_float_equal(lp_ptp_shutter_us(chosen[0]), 6e7, 1);
	assert_int_equal(lp_ptp_choose(&(struct lp_ptp_values){.count = 0}, 0, 3, 3, chosen), 0);
}

/* Cut off anywhere: what is missing is zero, and said to be missing. */
static void test_data_that_end_early(void **state)
{
	struct lp_ptp_values values;
	struct lp_ptp_device device;
	uint8_t data[64] = {0x0f, 0x50, 4, 0, 1, 0, 0, 0, 0, 2, 2, 0, 50, 0, 100, 0};

	(void)state;
	assert_true(lp_ptp_values_read(data, 16, &values));
	assert_int_equal(values.count, 2);
	assert_int_equal(values.values[1], 100);
	for (size_t size = 0; size < 16; size++)
		assert_false(lp_ptp_values_read(data, size, &values));
	data[2] = 10; /* 128 bits: no number */
	assert_false(lp_ptp_values_read(data, 16, &values));
	memset(data, 0xff, sizeof(data));
	for (size_t size = 0; size <= sizeof(data); size++) {
		assert_false(lp_ptp_device_read(data, size, &device));
		assert_true(isnan(lp_photo_read(data, size).exposure_us));
	}
}

/* ---------------------------------------------------------------- stills */

static void test_each_still_has_its_own_exposure(void **state)
{
	static const float asked_us[] = {62.5F, 500, 4000};

	(void)state;
	create("ptp:?every=0.001&exposures=3");
	send_stills(6);
	UNTIL(heard.frames >= 6);
	for (int i = 0; i < 6; i++)
		assert_float_equal(heard.exposures_us[i], asked_us[i % 3], 0.1);
	assert_float_equal(heard.last.gain, 1, 0);
	assert_true(heard.last.flags & LP_FRAME_STILL);
	assert_int_equal(heard.last.width_px, 64);
	UNTIL(fake_theta_get(&fake_theta.deleted) >= 6);
}

/* Hours before the next set would come by itself, or where none would. */
static void test_a_set_on_request(void **state)
{
	static const char *const uris[] = {"ptp:?every=3600&exposures=2",
					   "ptp:?every=0&exposures=2"};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(uris); k++) {
		create(uris[k]);
		send_stills(2);
		UNTIL(heard.frames >= 2);
		source->ops->take_stills(source);
		send_stills(2);
		UNTIL(heard.frames >= 4);
		destroy();
	}
}

static void test_stills_may_stay_in_the_camera(void **state)
{
	(void)state;
	create("ptp:?every=0.001&exposures=2&keep=1");
	send_stills(4);
	UNTIL(heard.frames >= 4);
	assert_int_equal(fake_theta_get(&fake_theta.deleted), 0);
}

/* The lowest sensitivity that is listed, or the one that is asked for. */
static void test_sensitivities(void **state)
{
	const uint8_t *bracket = fake_theta_property(0xD812)->value;

	(void)state;
	create("ptp:?every=0.001&exposures=2&iso=100");
	send_stills(2);
	UNTIL(heard.frames == 2);
	assert_int_equal(bracket[4 + 2], 100);
	assert_float_equal(heard.last.gain, 1, 0);
	destroy();
	fake_theta_plug();
	create("ptp:?iso=99");
	UNTIL(heard.state == LP_SOURCE_DOWN);
	assert_contains(heard.reason, "99 is not offered");
}

static void assert_as_before(const struct fake_property *before)
{
	for (int i = 0; i < FAKE_THETA_PROPERTIES; i++) {
		const struct fake_property *now = &fake_theta.properties[i];

		if (now->size_bytes != before[i].size_bytes ||
		    memcmp(now->value, before[i].value, now->size_bytes) != 0)
			fail_msg("property 0x%04x was not put back", now->code);
	}
}

static void test_options_are_put_back(void **state)
{
	struct fake_property before[FAKE_THETA_PROPERTIES];

	(void)state;
	memcpy(before, fake_theta.properties, sizeof(before));
	create("ptp:?every=0.001&exposures=2");
	send_stills(2);
	UNTIL(heard.frames == 2);
	destroy();
	assert_as_before(before);
	assert_false(fake_theta.has_session);
	/* also of a camera that was away meanwhile */
	create("ptp:?every=0.001&exposures=2");
	send_stills(2);
	UNTIL(heard.frames == 2);
	fake_theta_unplug();
	UNTIL(heard.state == LP_SOURCE_WAITING);
	fake_theta_plug();
	send_stills(2);
	UNTIL(heard.frames == 4);
	destroy();
	assert_as_before(before);
}

/* A set that is under way when the daemon ends is ended, too; its stills do not stay. */
static void test_a_set_is_cut_short(void **state)
{
	(void)state;
	create("ptp:?every=0.001&exposures=3");
	send_stills(1);
	UNTIL(heard.frames == 1 && fake_theta_get(&fake_theta.left) == 2);
	destroy();
	assert_int_equal(fake_theta.left, -1);
	assert_int_equal(fake_theta.deleted, 1);
	assert_false(fake_theta.has_session);
}

/* ---------------------------------------------------------------- moods */

static void test_what_a_camera_may_do(void **state)
{
	(void)state;
	fake_theta.has_session = true; /* left by a program that crashed */
	fake_theta.stale = true;
	fake_theta.split = true;
	fake_theta.busy = 3;
	create("ptp:?every=0.001&exposures=2");
	send_stills(2);
	UNTIL(heard.frames == 2);
	assert_int_equal(heard.state, LP_SOURCE_STREAMING);
	FAKE_THETA_LOCKED(fake_theta.busy = 2);
	send_stills(2);
	UNTIL(heard.frames == 4);
}

/* Data that fill their last packet to the brim. */
static void test_pictures_of_any_size(void **state)
{
	(void)state;
	create("ptp:?every=0.001&exposures=2");
	for (int i = 0; i < 4; i++) {
		uint8_t *jpeg = fake_theta.jpeg;

		FAKE_THETA_LOCKED({
			/* bytes after the end of the picture are none of it */
			while ((12 + 6 + 6 + 70 + fake_theta.jpeg_bytes - 2) % FAKE_THETA_PACKET !=
			       (size_t)i % 2) {
				jpeg = realloc(jpeg, fake_theta.jpeg_bytes + 1);
				jpeg[fake_theta.jpeg_bytes++] = 0;
			}
			fake_theta.jpeg = jpeg;
		});
		send_stills(1);
		UNTIL(heard.frames == i + 1);
		assert_false(heard.last.flags & LP_FRAME_CORRUPT);
	}
}

static void assert_down(const char *uri, const char *reason)
{
	create(uri);
	UNTIL(heard.state == LP_SOURCE_DOWN || heard.state == LP_SOURCE_WAITING);
	assert_contains(heard.reason, reason);
	assert_int_equal(heard.frames, 0);
	destroy();
	fake_theta_init();
	fake_theta_plug();
}

static void test_cameras_that_do_not_do(void **state)
{
	struct fake_property before[FAKE_THETA_PROPERTIES];

	(void)state;
	fake_theta.model = "RICOH THETA S";
	assert_down("ptp:", "RICOH THETA S: brackets are known of RICOH THETA X, Z1 and V only");
	fake_theta.model = "RICOH THETA V";
	assert_down("ptp:", "firmware 2.71.1 has other brackets");
	assert_down("ptp:?exposures=13", "the camera lists only");
	fake_theta_property(0x5013)->value[0] = 5;
	fake_theta_property(0x5013)->value[1] = 0x80;
	assert_down("ptp:", "live streaming mode");
	fake_theta_property(0xD808)->value[0] = 3;
	assert_down("ptp:", "takes other pictures now");
	memcpy(before, fake_theta.properties, sizeof(before));
	fake_theta.refused = 0xD812;
	create("ptp:");
	UNTIL(heard.state == LP_SOURCE_DOWN);
	assert_contains(heard.reason, "bracket: the camera refuses: value not allowed");
	destroy();
	assert_as_before(before); /* nothing is left behind */
}

static void test_addresses(void **state)
{
	const struct lp_source_host host = {.loop = loop};

	(void)state;
	assert_int_equal(lp_source_open("ptp:1/2", &host, &source), -EINVAL);
	assert_int_equal(lp_source_open("ptp:?exposures=1", &host, &source), -EINVAL);
	assert_int_equal(lp_source_open("ptp:?exposures=14", &host, &source), -EINVAL);
	assert_int_equal(lp_source_open("ptp:YN10100042", &host, &source), 0);
}

#define PTP_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_brackets_are_laid_out_as_published),
		cmocka_unit_test(test_exposures_are_of_the_list),
		cmocka_unit_test(test_data_that_end_early),
		PTP_TEST(test_each_still_has_its_own_exposure),
		PTP_TEST(test_a_set_on_request),
		PTP_TEST(test_stills_may_stay_in_the_camera),
		PTP_TEST(test_sensitivities),
		PTP_TEST(test_options_are_put_back),
		PTP_TEST(test_a_set_is_cut_short),
		PTP_TEST(test_what_a_camera_may_do),
		PTP_TEST(test_pictures_of_any_size),
		PTP_TEST(test_cameras_that_do_not_do),
		PTP_TEST(test_addresses),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
