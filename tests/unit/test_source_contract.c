/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What include/source.h promises of every source, tested on all of them: in every test each
 * callback is checked against the contract. A v4l2 camera is made by fake_v4l2.h, one on the
 * network by fake_osc.h, one for stills by fake_theta.h; libcamera: has the same tests on a real
 * kernel (tests/kernel/guest/test_uvc_contract.py).
 */
#include "lp_test.h"

#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "app/backends.h"
#include "base/clock.h"
#include "base/uri.h"
#include "drivers/source/sim/header.h"
#include "fake_osc.h"
#include "fake_theta.h"
#include "fake_v4l2.h"
#include "include/frame.h"
#include "include/processing.h"
#include "include/source.h"
#include "loop_test.h"

#define PATIENCE_NS (60 * LP_NS_PER_S) /* the machine may be busy */

static struct lp_loop *loop;
static struct lp_source *source;
static char folder[32];

/* ---------------------------------------------------------------- what is heard, and checked */

/* One letter for each callback: state D(own) W(aiting) T (streaming) L (stalled) E(nded), f: usable
 * frame, c: corrupt frame, x: corrupt frame that was only counted. */
static struct {
	char trace[4096];
	size_t length;
	char reason[512]; /* of the last state */
	enum lp_source_state state;
	bool in_op, was_last;
	const char *violation; /* of the contract; NULL: none */
	pthread_t loop_thread;
	struct lp_source_caps caps; /* when STREAMING was reported */
} heard;

/* A callback must not leave the loop by a failed assertion: the test fails at its next step. */
#define MUST(condition)                               \
	do {                                          \
		if (!(condition) && !heard.violation) \
			heard.violation = #condition; \
	} while (0)

static void note(char letter)
{
	MUST(!heard.in_op); /* 1 of the contract */
	MUST(pthread_equal(pthread_self(), heard.loop_thread));
	MUST(heard.state != LP_SOURCE_ENDED); /* 6 */
	if (heard.length < sizeof(heard.trace) - 1)
		heard.trace[heard.length++] = letter;
}

static void on_frame(void *context, struct lp_frame *frame)
{
	const bool corrupt = frame->flags & LP_FRAME_CORRUPT;

	(void)context;
	note(corrupt ? 'c' : 'f');
	MUST(heard.state == LP_SOURCE_STREAMING); /* 2, 4 */
	MUST(!heard.was_last);			  /* 6 */
	MUST(heard.caps.reports_exposure || heard.caps.exposure_settable ||
	     isnan(frame->exposure_us));
	MUST(!heard.caps.reports_exposure || corrupt || !isnan(frame->exposure_us));
	MUST(frame->t_read_ns > 0 && frame->t_read_ns <= frame->t_arrival_ns);
	heard.was_last = frame->flags & LP_FRAME_LAST;
	lp_frame_release(frame);
}

static void on_corrupt(void *context)
{
	(void)context;
	note('x');
	MUST(heard.state != LP_SOURCE_STREAMING); /* 3 */
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	(void)context;
	note("-DWTLE"[state]);
	MUST(state != heard.state || strcmp(reason, heard.reason) != 0); /* 5 */
	MUST(state != LP_SOURCE_ENDED || heard.was_last);		 /* 6 */
	heard.state = state;
	(void)snprintf(heard.reason, sizeof(heard.reason), "%s", reason);
	if (state == LP_SOURCE_STREAMING)
		source->ops->caps(source, &heard.caps);
}

static void assert_no_violation(void)
{
	if (heard.violation)
		fail_msg("against the contract: %s; heard %s: %s", heard.violation, heard.trace,
			 heard.reason);
}

/* The trace without states W, D and L before the stream, which depend on who was first. */
static const char *since_the_stream(void)
{
	static char text[sizeof(heard.trace)];
	size_t length = 0;

	for (size_t i = 0; i < heard.length; i++) {
		if (length > 0 || !strchr("WDL", heard.trace[i]))
			text[length++] = heard.trace[i];
	}
	text[length] = '\0';
	return text;
}

static void assert_heard(const char *begin)
{
	const char *text = since_the_stream();

	if (strncmp(text, begin, strlen(begin)) != 0)
		fail_msg("heard '%s', expected '%s'", text, begin);
}

static int count(char letter)
{
	int found = 0;

	for (size_t i = 0; i < heard.length; i++)
		found += heard.trace[i] == letter;
	return found;
}

#define UNTIL(condition)                                                                        \
	do {                                                                                    \
		const int64_t end_ns = lp_clock_ns() + PATIENCE_NS;                             \
		while (!(condition)) {                                                          \
			assert_no_violation();                                                  \
			if (lp_clock_ns() > end_ns)                                             \
				fail_msg("not seen: %s; heard %s: %s", #condition, heard.trace, \
					 heard.reason);                                         \
			(void)loop_turn(loop, 20);                                              \
		}                                                                               \
		assert_no_violation();                                                          \
	} while (0)

/* ---------------------------------------------------------------- devices */

/* One kind of source, and the device at its other end. */
struct device {
	const char *name;
	/* The URI, for a device that gives these frames (G: good, C: corrupt) again and again, if
	 * it does so by itself. */
	const char *(*uri)(const char *frames);
	/* NULL: it gives its frames by itself. False: not yet. */
	bool (*send)(bool corrupt);
	void (*nudge)(void); /* readable, and nothing to read */
	void (*plug)(void);
	void (*unplug)(void);
};

static char uri_text[256];

static void write_picture(int number, size_t size_bytes)
{
	char path[64];
	FILE *file;

	(void)snprintf(path, sizeof(path), "%s/%03d.grey", folder, number);
	file = fopen(path, "wb");
	assert_non_null(file);
	assert_int_equal(fwrite("pppp", 1, size_bytes, file), size_bytes);
	assert_int_equal(fclose(file), 0);
}

/* A corrupt picture is one that is cut off. */
static const char *file_uri(const char *frames)
{
	for (int i = 0; frames[i]; i++)
		write_picture(i, frames[i] == 'G' ? 4 : 2);
	(void)snprintf(uri_text, sizeof(uri_text), "file:%s?size=2x2&rate=500", folder);
	return uri_text;
}

static const char *example_uri(const char *frames)
{
	(void)snprintf(uri_text, sizeof(uri_text), "example:?rate=200&corrupt_first=%zu",
		       strchr(frames, 'G') ? strcspn(frames, "G") : 1000000);
	return uri_text;
}

static struct {
	int listener, peer;
	float exposure_us; /* of the frames it sends */
} simulator = {.listener = -1, .peer = -1};

static const char *sim_uri(const char *frames)
{
	(void)frames;
	(void)snprintf(uri_text, sizeof(uri_text), "sim:%s/sim", folder);
	return uri_text;
}

static void sim_plug(void)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};

	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s/sim", folder);
	simulator.listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	assert_int_equal(bind(simulator.listener, (struct sockaddr *)&address, sizeof(address)), 0);
	assert_int_equal(listen(simulator.listener, 1), 0);
}

static void sim_unplug(void)
{
	char path[64];

	if (simulator.peer >= 0)
		close(simulator.peer);
	if (simulator.listener >= 0)
		close(simulator.listener);
	simulator.peer = simulator.listener = -1;
	(void)snprintf(path, sizeof(path), "%s/sim", folder);
	unlink(path);
}

static bool sim_is_connected(void)
{
	if (simulator.peer < 0)
		simulator.peer = accept(simulator.listener, NULL, NULL);
	return simulator.peer >= 0;
}

static bool sim_send(bool corrupt)
{
	static uint64_t sequence;
	const int64_t start_ns = lp_clock_ns();
	const uint32_t flags = corrupt;
	uint8_t data[LP_SIM_HEADER_BYTES + 4] = "LPF1";

	if (!sim_is_connected())
		return false;
	memcpy(data + 4, &(uint32_t){LP_SIM_HEADER_BYTES}, 4);
	memcpy(data + 8, &(uint64_t){4}, 8);
	memcpy(data + 16, "GREY", 4);
	memcpy(data + 20, &(uint32_t){2}, 4);
	memcpy(data + 24, &(uint32_t){2}, 4);
	memcpy(data + 32, &(uint64_t){sequence++}, 8);
	memcpy(data + 40, &start_ns, 8);
	memcpy(data + 48, corrupt ? &(float){NAN} : &simulator.exposure_us, 4);
	memcpy(data + 52, &(float){1}, 4);
	memcpy(data + 56, &flags, 4);
	assert_int_equal(write(simulator.peer, data, sizeof(data)), sizeof(data));
	return true;
}

/* The beginning of a frame, whose rest is long in coming. */
static void sim_nudge(void)
{
	UNTIL(sim_is_connected());
}

static const char *v4l2_uri(const char *frames)
{
	(void)frames;
	return "v4l2:?stall_ms=100";
}

static void v4l2_plug(void)
{
	fake_v4l2_plug(0);
}

static void v4l2_unplug(void)
{
	fake_v4l2_unplug(0);
}

static bool v4l2_send(bool corrupt)
{
	return fake_v4l2_send(0, corrupt);
}

static void v4l2_nudge(void)
{
	UNTIL(fake_v4l2_get(&fake_v4l2.cameras[0].streams));
	for (int i = 0; i < 3; i++)
		fake_v4l2_wake_without_frame(0);
}

static const char *osc_uri(const char *frames)
{
	(void)frames;
	(void)snprintf(uri_text, sizeof(uri_text), "osc:127.0.0.1:%u?stall_ms=1000",
		       (unsigned)fake_osc.port);
	return uri_text;
}

/* A boundary and the beginning of a header. */
static void osc_nudge(void)
{
	UNTIL(fake_osc_put("--fake-osc-next\r\nContent-", 25));
	(void)fake_osc_put("Type: image/jpeg\r\n", 18);
}

static const char *ptp_uri(const char *frames)
{
	(void)frames;
	return "ptp:?every=0.001&exposures=3";
}

/* Events that are no stills. */
static void ptp_nudge(void)
{
	UNTIL(fake_theta_get(&fake_theta.sets) > 0);
}

static const struct device devices[] = {
	{.name = "file", .uri = file_uri},
	{.name = "example", .uri = example_uri},
	{"sim", sim_uri, sim_send, sim_nudge, sim_plug, sim_unplug},
	{"v4l2", v4l2_uri, v4l2_send, v4l2_nudge, v4l2_plug, v4l2_unplug},
	{"osc", osc_uri, fake_osc_send, osc_nudge, fake_osc_plug, fake_osc_unplug},
	{"ptp", ptp_uri, fake_theta_send, ptp_nudge, fake_theta_plug, fake_theta_unplug},
};

/* ---------------------------------------------------------------- a source and its device */

static void create(const char *uri)
{
	const struct lp_source_host host = {.loop = loop,
					    .frame = on_frame,
					    .corrupt = on_corrupt,
					    .state = on_state};

	memset(&heard, 0, sizeof(heard));
	heard.loop_thread = pthread_self();
	heard.in_op = true;
	assert_int_equal(lp_source_open(uri, &host, &source), 0);
	assert_int_equal(source->ops->start(source), 0);
	heard.in_op = false;
}

static void destroy(void)
{
	heard.in_op = true;
	if (source)
		source->ops->destroy(source);
	source = NULL;
	assert_no_violation();
}

/* Send these frames as soon as the device can. */
static void send_frames(const struct device *device, const char *frames)
{
	for (; device->send && *frames; frames++)
		UNTIL(device->send(*frames == 'C'));
}

static void begin(const struct device *device, const char *frames)
{
	print_message("           %s:\n", device->name);
	if (device->plug)
		device->plug();
	create(device->uri(frames));
	send_frames(device, frames);
}

static void end(const struct device *device)
{
	char command[64];

	destroy();
	if (device->unplug)
		device->unplug();
	(void)snprintf(command, sizeof(command), "rm -rf %s/*", folder);
	assert_int_equal(system(command), 0); /* NOLINT(cert-env33-c) */
	fake_v4l2_init();
	fake_theta_init();
}

/* ---------------------------------------------------------------- all sources */

static void test_streaming_comes_before_the_first_frame(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		begin(device, "GGG");
		UNTIL(count('f') >= 3);
		assert_heard("Tfff");
		end(device);
	}
}

static void test_corrupt_frames_first_are_counted(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		begin(device, "CCGG");
		UNTIL(count('f') >= 2);
		assert_heard("xxTff");
		end(device);
	}
}

static void test_corrupt_frames_later_are_handed_on(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		if (!device->send) /* the second round of a file: below */
			continue;
		begin(device, "GCG");
		UNTIL(count('f') >= 2);
		assert_heard("Tfcf");
		end(device);
	}
}

/* Another corrupt frame, now and then. */
static bool goes_on(const struct device *device)
{
	static int64_t sent_ns;

	if (device->send && lp_clock_ns() - sent_ns > 20 * LP_NS_PER_MS && device->send(true))
		sent_ns = lp_clock_ns();
	return true;
}

static void test_only_corrupt_frames_are_a_stall(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		begin(device, "CCC");
		UNTIL(count('L') > 0 || !goes_on(device));
		assert_non_null(strstr(heard.reason, "corrupt") ?: strstr(heard.reason, "damaged"));
		assert_true(count('x') >= 1);
		assert_int_equal(count('T') + count('f') + count('c'), 0);
		/* One frame is not enough: it may be lost while the camera is opened anew. */
		if (device->send)
			UNTIL(count('f') > 0 || (device->send(false), false));
		assert_int_equal(count('T'), device->send ? 1 : 0);
		end(device);
	}
}

static void test_readable_and_nothing_to_read(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		if (!device->nudge)
			continue;
		begin(device, "");
		device->nudge();
		assert_heard("");
		send_frames(device, "G");
		UNTIL(count('f') > 0);
		assert_heard("Tf");
		end(device);
	}
}

static void test_it_goes_and_comes_back(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		if (!device->unplug)
			continue;
		begin(device, "G");
		UNTIL(count('f') == 1);
		device->unplug();
		UNTIL(heard.state == LP_SOURCE_WAITING);
		device->plug();
		send_frames(device, "CG");
		UNTIL(count('f') == 2);
		assert_int_equal(count('T'), 2);
		assert_int_equal(count('x'), 1);
		end(device);
	}
}

static void test_destroyed_at_any_time(void **state)
{
	(void)state;
	for (const struct device *device = devices; device < devices + LP_COUNT(devices);
	     device++) {
		begin(device, device->send ? "" : "G");
		end(device);
		begin(device, "GG");
		end(device);
	}
}

/* ---------------------------------------------------------------- exposure */

static bool reports_exposure(const char *uri, const struct device *device)
{
	create(uri);
	send_frames(device, "CGG");
	UNTIL(count('f') >= 1);
	return heard.caps.reports_exposure;
}

static void test_whether_exposure_is_reported_is_known_with_the_stream(void **state)
{
	const struct device *const file = &devices[0], *const example = &devices[1],
				   *const sim = &devices[2], *const v4l2 = &devices[3];
	char text[300];

	(void)state;
	(void)snprintf(text, sizeof(text), "%s&exposures_us=100", file_uri("CGG"));
	assert_true(reports_exposure(text, file));
	destroy();
	assert_false(reports_exposure(file_uri("CGG"), file));
	end(file);
	assert_false(reports_exposure("example:", example));
	end(example);
	sim->plug();
	simulator.exposure_us = 1000;
	assert_true(reports_exposure(sim->uri(""), sim));
	end(sim);
	sim->plug();
	simulator.exposure_us = NAN;
	assert_false(reports_exposure(sim->uri(""), sim));
	end(sim);
	v4l2->plug();
	assert_false(reports_exposure(v4l2->uri(""), v4l2));
	end(v4l2);
}

/* ---------------------------------------------------------------- a camera on the network */

static bool osc_was_told(const char *exposure)
{
	bool was_told;

	pthread_mutex_lock(&fake_osc.lock);
	was_told = strstr(fake_osc.exposure, exposure) != NULL;
	pthread_mutex_unlock(&fake_osc.lock);
	return was_told;
}

/* Only what the camera lists, in its own digits; what ends after the next frame begins is left out.
 */
static void test_exposures_of_a_list(void **state)
{
	const struct device *const osc = &devices[4];

	(void)state;
	begin(osc, "G");
	UNTIL(count('f') == 1);
	assert_true(heard.caps.exposure_settable);
	assert_int_equal(heard.caps.exposure_count, 3);
	assert_float_equal(heard.caps.exposures_us[0], 1000, 0.1);
	assert_float_equal(heard.caps.exposures_us[2], 4000, 0.1);
	assert_float_equal(heard.caps.gain_max, 2, 1e-6);
	assert_true(osc_was_told("\"shutterSpeed\":0.004,\"iso\":100"));
	assert_int_equal(source->ops->set_exposure(source, 1600, 1.9F), 0);
	UNTIL(osc_was_told("\"shutterSpeed\":0.002,\"iso\":200"));
	end(osc);
}

/* ---------------------------------------------------------------- files, which end */

static void test_a_file_ends_with_its_last_picture(void **state)
{
	char text[300];

	(void)state;
	(void)snprintf(text, sizeof(text), "%s&loop=0", file_uri("CGCGC"));
	create(text);
	UNTIL(heard.state == LP_SOURCE_ENDED);
	assert_heard("xTfcfcE");
	assert_true(heard.was_last);
	end(&devices[0]);
}

static void test_a_file_without_a_usable_picture_is_down(void **state)
{
	char text[300];

	(void)state;
	(void)snprintf(text, sizeof(text), "%s&loop=0", file_uri("CCC"));
	create(text);
	UNTIL(heard.state == LP_SOURCE_DOWN);
	assert_int_equal(count('x'), 3);
	end(&devices[0]);
}

/* ---------------------------------------------------------------- cameras of v4l2 */

static void test_a_reason_that_changes_is_reported(void **state)
{
	(void)state;
	create("v4l2:");
	UNTIL(strstr(heard.reason, "no camera is present"));
	FAKE_V4L2_SET(0, open_error, EBUSY);
	fake_v4l2_plug(0);
	UNTIL(strstr(heard.reason, "device busy"));
	fake_v4l2_plug(1);
	UNTIL(strstr(heard.reason, "several cameras match"));
	assert_int_equal(count('W'), 3);
	assert_int_equal(heard.length, 3);
	FAKE_V4L2_SET(0, open_error, 0);
	fake_v4l2_unplug(1);
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') == 1);
	end(&devices[3]);
}

static void test_another_model_is_named_and_not_taken(void **state)
{
	(void)state;
	begin(&devices[3], "G");
	UNTIL(count('f') == 1);
	fake_v4l2_unplug(0);
	UNTIL(strstr(heard.reason, "model 0102 is unplugged: waiting for it to come back"));
	fake_v4l2_plug(1);
	UNTIL(strstr(heard.reason, "model 0102 is unplugged; present: /dev/video1 (model 0103"));
	assert_int_equal(fake_v4l2_get(&fake_v4l2.cameras[1].opened), 0);
	fake_v4l2_plug(0);
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') == 2);
	end(&devices[3]);
}

/* A new camera whose node udevd has not yet given its group, after one that was of no use. */
static void test_a_camera_swapped_for_another(void **state)
{
	(void)state;
	fake_v4l2.cameras[0].offers_nothing = true;
	fake_v4l2_plug(0);
	create("v4l2:");
	UNTIL(heard.state == LP_SOURCE_DOWN);
	fake_v4l2_unplug(0);
	FAKE_V4L2_SET(1, open_error, EACCES);
	fake_v4l2_plug(1);
	UNTIL(fake_v4l2_get(&fake_v4l2.cameras[1].opened) > 0);
	FAKE_V4L2_SET(1, open_error, 0); /* and nobody says so */
	UNTIL(fake_v4l2_send(1, false));
	UNTIL(count('f') == 1);
	assert_string_equal(heard.trace, "DTf"); /* the passing refusal is not worth a word */
	end(&devices[3]);
}

static void test_a_refusal_that_stays_is_reported(void **state)
{
	(void)state;
	FAKE_V4L2_SET(0, open_error, EACCES);
	fake_v4l2_plug(0);
	create("v4l2:");
	UNTIL(strstr(heard.reason, "no permission"));
	FAKE_V4L2_SET(0, open_error, 0);
	fake_v4l2_announce(); /* udevd's, with the new permissions */
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') == 1);
	end(&devices[3]);
}

static void test_a_rate_within_a_range_is_offered(void **state)
{
	struct v4l2_fract *interval = &fake_v4l2.cameras[0].interval;

	(void)state;
	fake_v4l2.cameras[0].any_rate = true;
	fake_v4l2_plug(0);
	create("v4l2:?fps=25");
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') == 1);
	assert_int_equal(interval->denominator, 25 * interval->numerator);
	destroy();
	create("v4l2:?fps=300");
	UNTIL(heard.state == LP_SOURCE_DOWN);
	assert_contains(heard.reason, "GREY 64x32 at 120 to 5");
	end(&devices[3]);
}

/* Each call to a camera that hangs takes five seconds: the first one that is not answered is the
 * last. */
static void test_a_camera_that_hangs_is_asked_once(void **state)
{
	(void)state;
	begin(&devices[3], "G");
	UNTIL(count('f') == 1);
	FAKE_V4L2_SET(0, control_calls, 0);
	FAKE_V4L2_SET(0, control_error, ETIMEDOUT);
	assert_int_equal(source->ops->set_exposure(source, 2000, 1), 0);
	UNTIL(heard.state == LP_SOURCE_STALLED);
	UNTIL(fake_v4l2_get(&fake_v4l2.resets) == 1);
	assert_true(fake_v4l2_get(&fake_v4l2.cameras[0].control_calls) <=
		    2); /* one of them when opened again */
	FAKE_V4L2_SET(0, control_error, 0);
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') == 2);
	FAKE_V4L2_SET(0, control_calls, 0);
	FAKE_V4L2_SET(0, control_error, ETIMEDOUT);
	destroy();
	assert_int_equal(fake_v4l2.cameras[0].control_calls, 1);
	end(&devices[3]);
}

static void test_controls_are_put_back(void **state)
{
	struct fake_control before[FAKE_CONTROLS];

	(void)state;
	memcpy(before, fake_v4l2.cameras[0].controls, sizeof(before));
	begin(&devices[3], "G");
	UNTIL(count('f') == 1);
	assert_memory_not_equal(before, fake_v4l2.cameras[0].controls, sizeof(before));
	destroy();
	assert_memory_equal(before, fake_v4l2.cameras[0].controls, sizeof(before));
	end(&devices[3]);
}

static int value_of(uint32_t id)
{
	return fake_v4l2_get(&fake_v4l2_find(0, id)->value);
}

/* A frame has come from the camera with these keys of its URI. */
static void stream_v4l2(const char *uri)
{
	create(uri);
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') > 0);
}

/* Off, or the least there is, or the maker's value; nothing is left to tell. */
static void test_processing_is_switched_off(void **state)
{
	(void)state;
	fake_v4l2_plug(0);
	stream_v4l2("v4l2:");
	assert_int_equal(value_of(V4L2_CID_SHARPNESS), 1);
	assert_int_equal(value_of(V4L2_CID_GAMMA), 220);
	assert_int_equal(value_of(V4L2_CID_CONTRAST), 32);
	assert_int_equal(value_of(V4L2_CID_SATURATION), 64);
	assert_int_equal(value_of(V4L2_CID_HUE), 0);
	assert_int_equal(value_of(V4L2_CID_WIDE_DYNAMIC_RANGE), 0);
	assert_int_equal(value_of(V4L2_CID_BACKLIGHT_COMPENSATION), 0);
	assert_int_equal(value_of(V4L2_CID_IMAGE_STABILIZATION), 0);
	assert_int_equal(value_of(V4L2_CID_COLORFX), V4L2_COLORFX_NONE);
	assert_int_equal(value_of(V4L2_CID_AUTO_WHITE_BALANCE), 0);
	assert_true(heard.caps.tells_processing);
	assert_int_equal(heard.caps.processing_on, 0);
	end(&devices[3]);
}

/* A camera that is plugged in again has forgotten everything. */
static void test_processing_is_switched_off_again(void **state)
{
	(void)state;
	fake_v4l2_plug(0);
	stream_v4l2("v4l2:");
	fake_v4l2_unplug(0);
	UNTIL(heard.state == LP_SOURCE_WAITING);
	fake_v4l2_find(0, V4L2_CID_SHARPNESS)->value = 3;
	fake_v4l2_plug(0);
	UNTIL(fake_v4l2_send(0, false));
	UNTIL(count('f') == 2);
	assert_int_equal(value_of(V4L2_CID_SHARPNESS), 1);
	destroy();
	assert_int_equal(value_of(V4L2_CID_SHARPNESS), 3);
	end(&devices[3]);
}

static void test_processing_that_stays_on_is_told(void **state)
{
	struct fake_control *const gamma = fake_v4l2_find(0, V4L2_CID_GAMMA);

	(void)state;
	gamma->flags = V4L2_CTRL_FLAG_READ_ONLY;
	fake_v4l2_find(0, V4L2_CID_CONTRAST)->flags = V4L2_CTRL_FLAG_GRABBED;
	fake_v4l2_find(0, V4L2_CID_SHARPNESS)->is_stubborn = true;
	fake_v4l2_find(0, V4L2_CID_WIDE_DYNAMIC_RANGE)->error = EACCES;
	fake_v4l2_find(0, V4L2_CID_SATURATION)->flags = V4L2_CTRL_FLAG_READ_ONLY; /* neutral */
	fake_v4l2_find(0, V4L2_CID_HUE)->id = 0;				  /* absent */
	fake_v4l2_plug(0);
	stream_v4l2("v4l2:");
	assert_int_equal(heard.caps.processing_on,
			 LP_PROCESSING_BIT(LP_PROCESSING_GAMMA) |
				 LP_PROCESSING_BIT(LP_PROCESSING_CONTRAST) |
				 LP_PROCESSING_BIT(LP_PROCESSING_SHARPNESS) |
				 LP_PROCESSING_BIT(LP_PROCESSING_DYNAMIC_RANGE));
	assert_int_equal(gamma->value, 300);
	end(&devices[3]);
}

/* For a camera file that was measured so. White balance is held all the same. */
static void test_processing_is_kept_on_request(void **state)
{
	(void)state;
	fake_v4l2_plug(0);
	stream_v4l2("v4l2:?processing=keep");
	assert_int_equal(value_of(V4L2_CID_SHARPNESS), 3);
	assert_int_equal(value_of(V4L2_CID_BACKLIGHT_COMPENSATION), 1);
	assert_int_equal(value_of(V4L2_CID_AUTO_WHITE_BALANCE), 0);
	assert_int_equal(heard.caps.processing_on,
			 LP_PROCESSING_BIT(LP_PROCESSING_GAMMA) |
				 LP_PROCESSING_BIT(LP_PROCESSING_CONTRAST) |
				 LP_PROCESSING_BIT(LP_PROCESSING_SHARPNESS) |
				 LP_PROCESSING_BIT(LP_PROCESSING_HUE) |
				 LP_PROCESSING_BIT(LP_PROCESSING_EFFECT) |
				 LP_PROCESSING_BIT(LP_PROCESSING_BACKLIGHT) |
				 LP_PROCESSING_BIT(LP_PROCESSING_STABILIZATION) |
				 LP_PROCESSING_BIT(LP_PROCESSING_DYNAMIC_RANGE));
	end(&devices[3]);
}

/* Its automatic mode cannot be left, but its result be kept. */
static void test_a_white_balance_is_locked(void **state)
{
	struct fake_control *const lock = fake_v4l2_find(0, V4L2_CID_HUE);

	(void)state;
	fake_v4l2_find(0, V4L2_CID_AUTO_WHITE_BALANCE)->error = EBUSY;
	fake_v4l2_plug(0);
	stream_v4l2("v4l2:");
	assert_int_equal(heard.caps.processing_on, LP_PROCESSING_BIT(LP_PROCESSING_WHITE_BALANCE));
	destroy();
	*lock = (struct fake_control){.id = V4L2_CID_3A_LOCK,
				      .value = V4L2_LOCK_FOCUS,
				      .maximum = 7};
	stream_v4l2("v4l2:");
	assert_int_equal(lock->value, V4L2_LOCK_FOCUS | V4L2_LOCK_WHITE_BALANCE);
	assert_int_equal(heard.caps.processing_on, 0);
	destroy();
	assert_int_equal(lock->value, V4L2_LOCK_FOCUS);
	end(&devices[3]);
}

static void test_a_loop_back_device_is_not_looked_at(void **state)
{
	(void)state;
	fake_v4l2_plug(0);
	FAKE_V4L2_SET(0, control_calls, 0);
	stream_v4l2("v4l2:?exposure=unknown");
	assert_int_equal(fake_v4l2_get(&fake_v4l2.cameras[0].control_calls), 0);
	assert_false(heard.caps.tells_processing);
	end(&devices[3]);
}

static int setup(void **state)
{
	(void)state;
	(void)strcpy(folder, "/tmp/lp-contract-XXXXXX");
	if (!mkdtemp(folder))
		return -1;
	simulator.exposure_us = 1000;
	fake_v4l2_init();
	fake_theta_init();
	return lp_loop_create(&loop);
}

static int teardown(void **state)
{
	(void)state;
	destroy(); /* of a test that failed */
	sim_unplug();
	fake_osc_unplug();
	lp_loop_destroy(loop);
	return rmdir(folder);
}

#define SOURCE_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		SOURCE_TEST(test_streaming_comes_before_the_first_frame),
		SOURCE_TEST(test_corrupt_frames_first_are_counted),
		SOURCE_TEST(test_corrupt_frames_later_are_handed_on),
		SOURCE_TEST(test_only_corrupt_frames_are_a_stall),
		SOURCE_TEST(test_readable_and_nothing_to_read),
		SOURCE_TEST(test_it_goes_and_comes_back),
		SOURCE_TEST(test_destroyed_at_any_time),
		SOURCE_TEST(test_whether_exposure_is_reported_is_known_with_the_stream),
		SOURCE_TEST(test_exposures_of_a_list),
		SOURCE_TEST(test_a_file_ends_with_its_last_picture),
		SOURCE_TEST(test_a_file_without_a_usable_picture_is_down),
		SOURCE_TEST(test_a_reason_that_changes_is_reported),
		SOURCE_TEST(test_another_model_is_named_and_not_taken),
		SOURCE_TEST(test_a_camera_swapped_for_another),
		SOURCE_TEST(test_a_refusal_that_stays_is_reported),
		SOURCE_TEST(test_a_rate_within_a_range_is_offered),
		SOURCE_TEST(test_a_camera_that_hangs_is_asked_once),
		SOURCE_TEST(test_controls_are_put_back),
		SOURCE_TEST(test_processing_is_switched_off),
		SOURCE_TEST(test_processing_is_switched_off_again),
		SOURCE_TEST(test_processing_that_stays_on_is_told),
		SOURCE_TEST(test_processing_is_kept_on_request),
		SOURCE_TEST(test_a_white_balance_is_locked),
		SOURCE_TEST(test_a_loop_back_device_is_not_looked_at),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
