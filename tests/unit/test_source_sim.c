/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "base/clock.h"
#include "base/uri.h"
#include "drivers/source/sim/header.h"
#include "include/frame.h"
#include "include/source.h"
#include "loop_test.h"

extern const struct lp_source_ops lp_source_sim_ops;

/* ---------------------------------------------------------------- header */

static int64_t frame_start_ns; /* 0: now */

/* Little-endian, as the machine that runs the tests. */
static void make_header(uint8_t header[LP_SIM_HEADER_BYTES], const char *format, uint32_t width,
			uint32_t height, uint64_t payload)
{
	const uint32_t header_bytes = 64, sequence_low = 5;
	const float exposure = 1000, gain = NAN;
	const int64_t start_ns = frame_start_ns ? frame_start_ns : lp_clock_ns();

	memset(header, 0, LP_SIM_HEADER_BYTES);
	memcpy(header, "LPF1", 4);
	memcpy(header + 4, &header_bytes, 4);
	memcpy(header + 8, &payload, 8);
	memcpy(header + 16, format, 4);
	memcpy(header + 20, &width, 4);
	memcpy(header + 24, &height, 4);
	memcpy(header + 32, &sequence_low, 4);
	memcpy(header + 40, &start_ns, 8);
	memcpy(header + 48, &exposure, 4);
	memcpy(header + 52, &gain, 4);
}

static void test_header_of_every_format(void **state)
{
	static const struct {
		const char *name;
		enum lp_pixel_format format;
		uint64_t bytes;
		uint32_t stride;
	} cases[] = {
		{"MJPG", LP_FORMAT_MJPEG, 100, 0},    {"YUYV", LP_FORMAT_YUYV, 48, 12},
		{"NV12", LP_FORMAT_NV12, 36, 6},      {"GREY", LP_FORMAT_GREY, 24, 6},
		{"RGBF", LP_FORMAT_RGB_F32, 288, 72},
	};

	(void)state;
	frame_start_ns = 123456789;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		uint8_t data[LP_SIM_HEADER_BYTES];
		struct lp_sim_header header;

		make_header(data, cases[i].name, 6, 4, cases[i].bytes);
		assert_null(lp_sim_header_parse(data, &header));
		assert_int_equal(header.format, cases[i].format);
		assert_int_equal(header.stride_bytes, cases[i].stride);
		assert_int_equal(header.flags, 0);
		assert_int_equal(header.sequence, 5);
		assert_int_equal(header.t_start_ns, 123456789);
		assert_true(header.exposure_us == 1000 && isnan(header.gain));
		if (cases[i].format == LP_FORMAT_MJPEG)
			continue;
		make_header(data, cases[i].name, 6, 4, cases[i].bytes - 1);
		assert_null(lp_sim_header_parse(data, &header));
		assert_int_equal(header.flags, LP_FRAME_CORRUPT);
	}
	frame_start_ns = 0;
}

static void test_bad_headers(void **state)
{
	static const struct {
		size_t offset;
		uint32_t value;
		const char *reason;
	} cases[] = {
		{0, 0, "LPF1"},		  {4, 63, "header_bytes"},    {4, 4097, "header_bytes"},
		{12, 1, "payload_bytes"}, {16, 0x34363248, "format"}, {20, 0, "width_px"},
		{24, 16385, "height_px"},
	};
	uint8_t data[LP_SIM_HEADER_BYTES];
	struct lp_sim_header header;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		make_header(data, "GREY", 6, 4, 24);
		memcpy(data + cases[i].offset, &cases[i].value, 4);
		const char *reason = lp_sim_header_parse(data, &header);

		assert_non_null(reason);
		assert_contains(reason, cases[i].reason);
	}
	make_header(data, "GREY", 6, 4, 24);
	data[28] = 5; /* stride below the width */
	assert_null(lp_sim_header_parse(data, &header));
	assert_int_equal(header.flags, LP_FRAME_CORRUPT);
	make_header(data, "GREY", 6, 4, 24);
	memcpy(data + 48, &(float){1e10F}, 4); /* exposed for hours */
	assert_null(lp_sim_header_parse(data, &header));
	assert_int_equal(header.flags, LP_FRAME_CORRUPT);
}

/* A header with everything that was added: orientation, sigma, row time, limits of exposure. */
static void make_long_header(uint8_t data[LP_SIM_HEADER_KNOWN_BYTES], uint32_t header_bytes,
			     const float more[13])
{
	make_header(data, "GREY", 6, 4, 24);
	memcpy(data + 4, &header_bytes, 4);
	memcpy(data + LP_SIM_HEADER_BYTES, more, 13 * sizeof(float));
}

static struct lp_sim_header parsed(uint32_t header_bytes, const float more[13])
{
	uint8_t data[LP_SIM_HEADER_KNOWN_BYTES];
	struct lp_sim_header header;

	make_long_header(data, header_bytes, more);
	assert_null(lp_sim_header_parse(data, &header));
	lp_sim_header_parse_more(data, &header);
	return header;
}

#define ORIENTATION 0.5F, -0.5F, 0.5F, 0.5F
static const float all_more[13] = {ORIENTATION, 0.25F, 12.5F, 100,   33000,
				   50,		1.0F,  0.5F,  -2.0F, 0.01F};

static void test_what_was_added_to_headers(void **state)
{
	static const float fixed[13] = {ORIENTATION, 0.25F, 12.5F, 0, 0, 0};
	struct lp_sim_header header = parsed(LP_SIM_HEADER_KNOWN_BYTES, all_more);

	(void)state;
	assert_false(header.exposure_fixed);
	assert_true(header.orientation[0] == 0.5F && header.orientation[1] == -0.5F &&
		    header.orientation[2] == 0.5F && header.orientation[3] == 0.5F);
	assert_true(header.orientation_sigma_deg == 0.25F && header.row_time_us == 12.5F);
	assert_true(header.exposure_min_us == 100 && header.exposure_max_us == 33000 &&
		    header.exposure_step_us == 50);
	assert_true(header.position_m[0] == 1.0F && header.position_m[2] == -2.0F &&
		    header.position_sigma_m == 0.01F);
	/* each of them only when all of it is there */
	header = parsed(115, all_more);
	assert_true(header.exposure_min_us == 100 && header.position_sigma_m == 0.0F);
	header = parsed(99, all_more);
	assert_true(header.row_time_us == 12.5F && isnan(header.exposure_min_us) &&
		    isnan(header.exposure_max_us) && isnan(header.exposure_step_us));
	header = parsed(87, all_more);
	assert_true(header.orientation[3] == 0.5F && isnan(header.row_time_us));
	header = parsed(LP_SIM_HEADER_KNOWN_BYTES, fixed);
	assert_true(header.exposure_fixed && isnan(header.exposure_max_us));
	header = parsed(LP_SIM_HEADER_BYTES, all_more);
	assert_true(isnan(header.orientation[0]) && isnan(header.orientation_sigma_deg));
}

static void test_added_numbers_that_make_no_sense_are_not_said(void **state)
{
	static const float cases[][13] = {
		{NAN, -0.5F, 0.5F, 0.5F, 1, -1, 33000, 100, 50, 0, NAN, 0, 0.1F},
		{ORIENTATION, -1, INFINITY, 100, NAN, 50, 0, 0, 0, -1},
		{0, 0, 0, 0, 1, NAN, 0, 33000, 50, 0, 0, 1e12F, 0.1F},
		{2, 0, 0, 0, 1, 1e12F, 100, 1e12F, 50, 0, 0, 0, INFINITY},
	};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		const struct lp_sim_header header = parsed(LP_SIM_HEADER_KNOWN_BYTES, cases[i]);

		for (size_t k = 0; k < 4; k++)
			assert_true(i == 1 ? header.orientation[k] == cases[i][k]
					   : isnan(header.orientation[k]));
		assert_true(header.position_sigma_m == 0.0F);
		assert_true(isnan(header.orientation_sigma_deg) && isnan(header.row_time_us));
		assert_true(isnan(header.exposure_min_us) && isnan(header.exposure_max_us) &&
			    isnan(header.exposure_step_us));
	}
}

/* ---------------------------------------------------------------- link */

static char path[64];
static int listener = -1, peer = -1;
static struct lp_source *source;
static struct {
	int frames, corrupt, counted;
	int64_t start_ns;
	const char *clock_fault;
	uint64_t sequence;
	uint8_t first_byte;
	float orientation[4], row_time_us;
	enum lp_source_state state;
	char reason[512];
} heard;

static void on_frame(void *context, struct lp_frame *frame)
{
	(void)context;
	heard.frames++;
	heard.corrupt += frame->flags & LP_FRAME_CORRUPT ? 1 : 0;
	heard.sequence = frame->sequence;
	heard.start_ns = frame->t_read_ns;
	heard.clock_fault = frame->clock_fault;
	heard.first_byte = frame->data[0];
	memcpy(heard.orientation, frame->orientation, sizeof(heard.orientation));
	heard.row_time_us = frame->row_time_us;
	lp_frame_release(frame);
}

static void on_corrupt(void *context)
{
	(void)context;
	heard.counted++;
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	(void)context;
	heard.state = state;
	(void)snprintf(heard.reason, sizeof(heard.reason), "%s", reason);
}

static void start_simulator(void)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};

	(void)strcpy(address.sun_path, path);
	listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	assert_int_equal(bind(listener, (struct sockaddr *)&address, sizeof(address)), 0);
	assert_int_equal(listen(listener, 1), 0);
}

static void stop_simulator(void)
{
	close(peer);
	close(listener);
	unlink(path);
	peer = listener = -1;
}

static struct lp_loop *loop;

static int setup(void **state)
{
	const int created = lp_loop_create(&loop);
	const struct lp_source_host host = {.loop = loop,
					    .frame = on_frame,
					    .corrupt = on_corrupt,
					    .state = on_state};
	struct lp_uri uri;
	char text[128];

	(void)state;
	assert_int_equal(created, 0);
	memset(&heard, 0, sizeof(heard));
	(void)snprintf(path, sizeof(path), "/tmp/lp-sim-%d.sock", (int)getpid());
	unlink(path);
	(void)snprintf(text, sizeof(text), "sim:%s?late_ms=40&drop=0.1", path);
	if (lp_uri_parse(&uri, text) < 0)
		return -1;
	return lp_source_sim_ops.create(&uri, &host, &source);
}

static int teardown(void **state)
{
	(void)state;
	lp_source_sim_ops.destroy(source);
	source = NULL;
	lp_loop_destroy(loop);
	if (listener >= 0)
		stop_simulator();
	return 0;
}

static void dispatch(int timeout_ms)
{
	(void)loop_turn(loop, timeout_ms);
}

static void pump_frames(int count)
{
	for (int i = 0; i < 6000 && heard.frames < count; i++)
		dispatch(10);
	assert_int_equal(heard.frames, count);
}

static void accept_peer(void)
{
	struct pollfd poll_fd = {.fd = listener, .events = POLLIN};

	while (poll(&poll_fd, 1, 10) == 0)
		dispatch(10);
	peer = accept(listener, NULL, NULL);
	assert_true(peer >= 0);
}

/* The next bytes that the daemon wrote. */
static const char *read_lines(void)
{
	static char text[512];
	const ssize_t got = read(peer, text, sizeof(text) - 1);

	assert_true(got > 0);
	text[got] = '\0';
	return text;
}

static void send_frame(uint8_t letter, size_t cut)
{
	uint8_t data[LP_SIM_HEADER_BYTES + 24];

	make_header(data, "GREY", 6, 4, 24);
	memset(data + LP_SIM_HEADER_BYTES, letter, 24);
	assert_int_equal(write(peer, data, sizeof(data) - cut), sizeof(data) - cut);
}

static void test_hello_frames_and_exposure(void **state)
{
	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	assert_string_equal(read_lines(), "hello late_ms=40&drop=0.1\n");
	send_frame('a', 0);
	pump_frames(1);
	assert_int_equal(heard.state, LP_SOURCE_STREAMING);
	assert_int_equal(heard.first_byte, 'a');
	assert_int_equal(heard.sequence, 5);
	send_frame('b', 0);
	send_frame('c', 0);
	pump_frames(3);
	assert_int_equal(heard.first_byte, 'c');
	assert_int_equal(lp_source_sim_ops.set_exposure(source, 2500, 1.5F), 0);
	assert_string_equal(read_lines(), "exposure 2500 1.5\n");
}

/* A frame with a header of any length, a byte at a time. */
static void send_in_single_bytes(uint32_t header_bytes, uint8_t letter)
{
	uint8_t data[LP_SIM_HEADER_KNOWN_BYTES + 16 + 24];

	make_long_header(data, header_bytes, all_more);
	memset(data + LP_SIM_HEADER_KNOWN_BYTES, 'x', 16);
	memset(data + header_bytes, letter, 24);
	for (size_t i = 0; i < header_bytes + 24; i++) {
		assert_int_equal(write(peer, data + i, 1), 1);
		dispatch(1000);
	}
}

static void test_frames_in_single_bytes_with_headers_of_any_length(void **state)
{
	static const uint32_t lengths[] = {64, 65, 84, 88, 99, 100, 101, 116};

	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	for (size_t i = 0; i < LP_COUNT(lengths); i++) {
		send_in_single_bytes(lengths[i], (uint8_t)('a' + i));
		pump_frames((int)i + 1);
		assert_int_equal(heard.first_byte, 'a' + i);
		assert_true(lengths[i] < 84 ? isnan(heard.orientation[0])
					    : heard.orientation[1] == -0.5F);
		assert_true(lengths[i] < 88 ? isnan(heard.row_time_us)
					    : heard.row_time_us == 12.5F);
	}
	assert_int_equal(heard.corrupt, 0);
}

static void test_limits_of_exposure_are_told(void **state)
{
	struct lp_source_caps caps;

	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	lp_source_sim_ops.caps(source, &caps);
	assert_true(isnan(caps.exposure_min_us) && isnan(caps.exposure_max_us));
	assert_true(caps.exposure_step_us == 0);
	send_in_single_bytes(LP_SIM_HEADER_KNOWN_BYTES, 'a');
	pump_frames(1);
	lp_source_sim_ops.caps(source, &caps);
	assert_true(caps.exposure_min_us == 100 && caps.exposure_max_us == 33000);
	assert_true(caps.exposure_step_us == 50);
}

static void test_absent_then_there_then_gone_then_back(void **state)
{
	(void)state;
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	while (heard.state != LP_SOURCE_WAITING)
		dispatch(1000);
	assert_contains(heard.reason, "lightprobe simulate");
	assert_int_equal(lp_source_sim_ops.set_exposure(source, 1, 1), -ENOTCONN);
	start_simulator();
	accept_peer();
	send_frame('a', 0);
	pump_frames(1);
	send_frame('b', 10); /* dies in the middle of a frame */
	stop_simulator();
	while (heard.state != LP_SOURCE_WAITING)
		dispatch(1000);
	assert_contains(heard.reason, "has gone");
	assert_int_equal(heard.frames, 1);
	start_simulator();
	accept_peer();
	send_frame('c', 0);
	pump_frames(2);
	assert_int_equal(heard.first_byte, 'c');
	assert_int_equal(heard.state, LP_SOURCE_STREAMING);
}

static void test_garbage_ends_the_link_not_the_daemon(void **state)
{
	uint8_t garbage[LP_SIM_HEADER_BYTES];

	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	memset(garbage, 'g', sizeof(garbage));
	assert_int_equal(write(peer, garbage, sizeof(garbage)), sizeof(garbage));
	while (heard.state != LP_SOURCE_WAITING)
		dispatch(1000);
	assert_contains(heard.reason, "LPF1");
	close(peer);
	accept_peer(); /* it tries again */
	send_frame('a', 0);
	pump_frames(1);
}

static void test_corrupt_frames_are_marked(void **state)
{
	uint8_t data[LP_SIM_HEADER_BYTES + 30];

	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	send_frame('a', 0);
	make_header(data, "GREY", 6, 4, 30); /* six bytes too many */
	assert_int_equal(write(peer, data, sizeof(data)), sizeof(data));
	send_frame('b', 0);
	pump_frames(3);
	assert_int_equal(heard.corrupt, 1);
	assert_int_equal(heard.counted, 0);
}

/* Sums of such times once overflowed. The picture counts; the arrival stands in. */
static void test_times_that_cannot_be(void **state)
{
	static const int64_t times_ns[] = {INT64_MIN, -1, 1, INT64_MAX};

	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	send_frame('a', 0);
	pump_frames(1);
	assert_null(heard.clock_fault);
	for (int i = 0; i < (int)LP_COUNT(times_ns); i++) {
		frame_start_ns = times_ns[i];
		send_frame('b', 0);
		pump_frames(i + 2);
		assert_non_null(heard.clock_fault);
		assert_true(llabs(heard.start_ns - lp_clock_ns()) < 600 * LP_NS_PER_S);
	}
	frame_start_ns = 0;
	assert_int_equal(heard.corrupt, 0);
}

static void test_silence_is_a_stall(void **state)
{
	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	accept_peer();
	while (heard.state != LP_SOURCE_STALLED)
		dispatch(5000);
	send_frame('a', 0);
	pump_frames(1);
	assert_int_equal(heard.state, LP_SOURCE_STREAMING);
}

static void test_a_simulator_that_is_busy(void **state)
{
	uint8_t busy[LP_SIM_HEADER_BYTES] = "BUSY";

	(void)state;
	start_simulator();
	assert_int_equal(lp_source_sim_ops.start(source), 0);
	for (int times = 0; times < 2; times++) {
		accept_peer();
		assert_int_equal(write(peer, busy, sizeof(busy)), sizeof(busy));
		close(peer); /* with the daemon's hello unread */
		while (heard.reason[0] == '\0')
			dispatch(10);
		assert_int_equal(heard.state, LP_SOURCE_WAITING);
		assert_contains(heard.reason, "busy — another lightprobed has this simulator");
	}
	accept_peer();
	send_frame('a', 0);
	pump_frames(1);
	assert_int_equal(heard.state, LP_SOURCE_STREAMING);
}

#define LINK_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_header_of_every_format),
		cmocka_unit_test(test_bad_headers),
		cmocka_unit_test(test_what_was_added_to_headers),
		cmocka_unit_test(test_added_numbers_that_make_no_sense_are_not_said),
		LINK_TEST(test_hello_frames_and_exposure),
		LINK_TEST(test_frames_in_single_bytes_with_headers_of_any_length),
		LINK_TEST(test_limits_of_exposure_are_told),
		LINK_TEST(test_absent_then_there_then_gone_then_back),
		LINK_TEST(test_garbage_ends_the_link_not_the_daemon),
		LINK_TEST(test_corrupt_frames_are_marked),
		LINK_TEST(test_times_that_cannot_be),
		LINK_TEST(test_silence_is_a_stall),
		LINK_TEST(test_a_simulator_that_is_busy),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
