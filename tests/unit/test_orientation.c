/* SPDX-License-Identifier: Apache-2.0 */
/* Head poses from clients to frames and packets: what counts, what is refused, and how it is told.
 */
#include "wire.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

#include "app/box/orientation.h"
#include "base/clock.h"
#include "include/frame.h"
#include "serve/health.h"
#include "serve/hub.h"

#define DEG (M_PI / 180.0)

struct lp_client {
	void *user;
	int errors, pongs;
	struct lp_packet *last; /* estimate, error or pong */
};

static struct lp_hub *hub;
static struct lp_health health;
static struct lp_publisher_host host;
static struct lp_orientation_teller teller;
static struct lp_client clients[2];
static int64_t clock_ns; /* of the clients, less ours */

static void keep(struct lp_publisher *publisher, struct lp_client *client, struct lp_packet *packet)
{
	const lightprobe_v1_FromProbe message = decode_packet(packet);

	(void)publisher;
	client->errors += message.which_message == lightprobe_v1_FromProbe_error_tag;
	client->pongs += message.which_message == lightprobe_v1_FromProbe_pong_tag;
	lp_packet_drop(client->last);
	client->last = lp_packet_hold(packet);
}

static const struct lp_publisher_ops ops = {.info = {.scheme = "test"}, .send = keep};
static struct lp_publisher publisher = {.ops = &ops};

static int on_pose(void *context, const void *client, const struct lp_orientation_sample *sample)
{
	(void)context;
	return lp_orientation_pose(&teller, client, sample);
}

static void on_left(void *context, const void *client)
{
	(void)context;
	lp_orientation_client_left(&teller, client);
}

static int setup_kind(enum lp_orientation_kind kind)
{
	const struct lp_hub_options options = {
		.hello = {.source = "test", .preset = "fast", .name = "a probe"},
		.initial = lp_default_subscription(),
		.ttl_ms = 1000,
		.max_clients = 2,
		.health = &health,
		.pose = on_pose,
		.left = on_left,
	};
	struct lp_mount mount;

	lp_clock_simulate(100 * LP_NS_PER_S);
	clock_ns = -7777 * LP_NS_PER_S;
	lp_health_init(&health, lp_clock_ns());
	assert_int_equal(lp_mount_read("", &mount), 0);
	lp_orientation_init(&teller, kind, &mount, &health);
	if (lp_hub_create(&options, &hub) < 0)
		return -1;
	host = lp_hub_publisher_host(hub);
	for (int i = 0; i < 2; i++) {
		clients[i] = (struct lp_client){0};
		assert_int_equal(host.connected(host.context, &publisher, &clients[i], 0, NULL,
						&clients[i].user),
				 0);
	}
	return 0;
}

static int setup(void **state)
{
	(void)state;
	return setup_kind(LP_ORIENTATION_CLIENT);
}

static void leave(struct lp_client *client)
{
	if (client->user)
		host.disconnected(host.context, client->user);
	client->user = NULL;
	lp_packet_drop(client->last);
	client->last = NULL;
}

static int teardown(void **state)
{
	(void)state;
	for (int i = 0; i < 2; i++)
		leave(&clients[i]);
	lp_hub_destroy(hub);
	return 0;
}

static void pass_ms(int ms)
{
	lp_clock_simulate(lp_clock_ns() + ms * LP_NS_PER_MS);
}

static int request(struct lp_client *client, const lightprobe_v1_FromClient *message)
{
	uint8_t data[LP_REQUEST_MAX_BYTES];
	pb_ostream_t stream = pb_ostream_from_buffer(data, sizeof(data));

	assert_true(pb_encode(&stream, lightprobe_v1_FromClient_fields, message));
	const int ret = host.request(host.context, client->user, data, stream.bytes_written);

	if (ret == 0)
		host.requests_done(host.context, client->user);
	return ret;
}

/* Where poses say that the head is; NULL: nowhere. */
static const float *head_m;

/* A pose of age_ms ago that has just arrived. */
static int send_pose(struct lp_client *client, double yaw_deg, int age_ms)
{
	lightprobe_v1_FromClient message = {
		.which_message = lightprobe_v1_FromClient_pose_tag,
		.message.pose = {.time_ns = lp_clock_ns() + clock_ns - age_ms * LP_NS_PER_MS,
				 .orientation_count = 4,
				 .orientation = {0, (float)sin(yaw_deg * DEG / 2), 0,
						 (float)cos(yaw_deg * DEG / 2)}}};

	message.message.pose.position_count = head_m ? 3 : 0;
	for (int a = 0; head_m && a < 3; a++)
		message.message.pose.position[a] = head_m[a];
	return request(client, &message);
}

/* Sent 2 ms ago; the answer to the one before took 2 ms, too. */
static void ping(struct lp_client *client, bool answered_before)
{
	static int64_t ponged_ns;
	const lightprobe_v1_FromClient message = {
		.which_message = lightprobe_v1_FromClient_ping_tag,
		.message.ping = {.time_ns = lp_clock_ns() + clock_ns - 2 * LP_NS_PER_MS,
				 .has_pong_time_ns = answered_before,
				 .pong_time_ns = ponged_ns + clock_ns + 2 * LP_NS_PER_MS}};

	assert_int_equal(request(client, &message), 0);
	ponged_ns = lp_clock_ns();
}

static const char *last_error(const struct lp_client *client)
{
	static lightprobe_v1_FromProbe message;

	message = decode_packet(client->last);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_error_tag);
	return message.message.error.text;
}

/* A frame whose exposure's middle was age_ms ago; NAN: it is not stamped. */
static double stamped_yaw_deg(int age_ms)
{
	struct lp_frame frame = {.t_read_ns =
					 lp_clock_ns() - age_ms * LP_NS_PER_MS + 3 * LP_NS_PER_MS,
				 .exposure_us = 8000.0F,
				 .row_time_us = 2.0F,
				 .height_px = 1000};

	lp_orientation_frame(&teller, &frame);
	assert_true(isnan(frame.orientation[0]) == isnan(frame.orientation_sigma_deg));
	return 2.0 * atan2((double)frame.orientation[1], (double)frame.orientation[3]) / DEG;
}

static bool has_fault(const char *id)
{
	for (int i = 0; i < health.report.fault_count; i++)
		if (strcmp(health.report.faults[i].id, id) == 0)
			return true;
	return false;
}

/* 30 degrees a second, a pose every 10 ms; each arrives late_ms after its time. */
static void turn_for_ms(struct lp_client *client, int ms, int late_ms)
{
	for (int t = 0; t < ms; t += 10) {
		const double now_s = (double)lp_clock_ns() / 1e9 - 100.0;

		assert_int_equal(send_pose(client, 30.0 * (now_s - 0.001 * late_ms), late_ms), 0);
		lp_orientation_tick(&teller, lp_clock_ns());
		pass_ms(10);
	}
}

static double true_yaw_deg(int age_ms)
{
	return 30.0 * ((double)lp_clock_ns() / 1e9 - 100.0 - 0.001 * age_ms);
}

/* By pings of a clock that is hours off, and by poses that take 4 ms, a frame knows how it was. */
static void test_frames_are_stamped_for_the_middle_of_their_exposure(void **state)
{
	(void)state;
	for (int n = 0; n < 3; n++) {
		ping(&clients[0], n > 0);
		turn_for_ms(&clients[0], 1000, 4);
	}
	assert_int_equal(clients[0].pongs, 3);
	for (int age_ms = 0; age_ms < 100; age_ms += 7)
		assert_float_equal(stamped_yaw_deg(age_ms), true_yaw_deg(age_ms), 0.01);
	assert_int_equal(clients[0].errors, 0);
	assert_int_equal(health.report.fault_count, 0);
}

/* Without pings the fastest pose counts as if it had taken no time. */
static void test_poses_alone_tell_the_clock(void **state)
{
	(void)state;
	turn_for_ms(&clients[0], 500, 4);
	assert_float_equal(stamped_yaw_deg(20), true_yaw_deg(20) - 30.0 * 0.004, 0.01);
}

static void test_poses_that_come_late_are_told(void **state)
{
	(void)state;
	ping(&clients[0], false);
	for (int n = 0; n < 3; n++) {
		pass_ms(10);
		ping(&clients[0], true);
	}
	for (int n = 0; n < 60; n++) {
		turn_for_ms(&clients[0], 30, 100);
		assert_true(isnan(stamped_yaw_deg(20)));
	}
	assert_true(has_fault("orientation-late"));
	for (int n = 0; n < 60; n++) {
		turn_for_ms(&clients[0], 30, 10);
		(void)stamped_yaw_deg(20);
	}
	assert_false(has_fault("orientation-late"));
	assert_float_equal(stamped_yaw_deg(20), true_yaw_deg(20), 0.05);
}

static void test_silence_is_told(void **state)
{
	(void)state;
	pass_ms(1100);
	lp_orientation_tick(&teller, lp_clock_ns());
	assert_true(has_fault("orientation-silent"));
	turn_for_ms(&clients[0], 300, 4);
	assert_false(has_fault("orientation-silent"));
	pass_ms(200);
	assert_true(isnan(stamped_yaw_deg(20)));
	pass_ms(1000);
	lp_orientation_tick(&teller, lp_clock_ns());
	assert_true(has_fault("orientation-silent"));
}

/* Poses with the time of a clock that the pings are not of. */
static void test_poses_of_another_clock_are_refused(void **state)
{
	(void)state;
	ping(&clients[0], false);
	pass_ms(10);
	ping(&clients[0], true);
	assert_int_equal(send_pose(&clients[0], 1.0, -3600 * 1000), 0);
	assert_contains(last_error(&clients[0]), "clock of the pings");
	assert_true(has_fault("orientation-clock"));
	pass_ms(1000);
	assert_int_equal(send_pose(&clients[0], 1.0, 3600 * 1000), 0);
	assert_int_equal(clients[0].errors, 2);
	assert_int_equal(teller.track.count, 0);
	assert_int_equal(send_pose(&clients[0], 1.0, 4), 0);
	assert_false(has_fault("orientation-clock"));
	assert_int_equal(teller.track.count, 1);
}

/* Until a ping is answered a pose seems to have come at once. Then it is known to be older, and
 * what the client sends in order would come before the last: a few are left out, and none is
 * refused. */
static void test_poses_overtaken_by_a_better_clock_are_nobodys_fault(void **state)
{
	(void)state;
	for (int n = 0; n < 10; n++, pass_ms(2))
		assert_int_equal(send_pose(&clients[0], 1.0, 8), 0);
	ping(&clients[0], false);
	pass_ms(1);
	ping(&clients[0], true);
	for (int n = 0; n < 10; n++, pass_ms(2))
		assert_int_equal(send_pose(&clients[0], 1.0, 8), 0);
	assert_int_equal(clients[0].errors, 0);
	assert_int_equal(health.report.requests_rejected, 0);
	assert_in_range(teller.track.count, 15, 19);
	assert_int_equal(send_pose(&clients[0], 1.0, 100), 0); /* by the client's own clock, too */
	assert_int_equal(health.report.requests_rejected, 1);
}

/* Bad numbers are told to who sent them, once a second; the connection and the others stay. */
static void test_what_is_no_rotation_is_refused(void **state)
{
	lightprobe_v1_FromClient message = {.which_message = lightprobe_v1_FromClient_pose_tag,
					    .message.pose = {.orientation_count = 4,
							     .orientation = {0, NAN, 0, 1}}};
	lightprobe_v1_Pose *const pose = &message.message.pose;

	(void)state;
	for (int n = 0; n < 50; n++) {
		assert_int_equal(send_pose(&clients[0], 1.0, 0), 0);
		pose->time_ns = lp_clock_ns() + clock_ns + 1;
		pose->orientation[1] = n % 2 ? NAN : 7.0F;
		assert_int_equal(request(&clients[0], &message), 0);
		pass_ms(10);
	}
	assert_int_equal(clients[0].errors, 1);
	assert_int_equal(health.report.requests_rejected, 50);
	assert_contains(last_error(&clients[0]), "unit quaternion");
	assert_int_equal(teller.track.count, 50);
	assert_int_equal(clients[1].errors, 0);
	assert_int_equal(send_pose(&clients[0], 1.0, 200), 0);
	assert_int_equal(health.report.requests_rejected, 51); /* older than the last one */
	assert_int_equal(teller.track.count, 50);
}

static void test_a_flood_is_bounded(void **state)
{
	int ret = 0, sent = 0;

	(void)state;
	while (ret == 0 && sent < 5000) {
		lp_clock_simulate(lp_clock_ns() + 100 * LP_NS_PER_US);
		ret = send_pose(&clients[0], 1.0, 0);
		sent++;
	}
	assert_int_equal(ret, -EDQUOT);
	assert_int_equal(sent, 2001);
	assert_int_equal(teller.track.count, 250);
	assert_int_equal(clients[0].errors, 2); /* some are left out; the end */
	assert_int_equal(send_pose(&clients[1], 1.0, 0),
			 0); /* another client's turn does not come */
	assert_contains(last_error(&clients[1]), "another client");
}

static lightprobe_v1_Estimate last_estimate(const struct lp_client *client)
{
	const lightprobe_v1_FromProbe message = decode_packet(client->last);

	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_estimate_tag);
	return message.message.estimate;
}

/* A lamp ahead (-Z) of a probe that has turned to the left by 90 degrees, when that is known. */
static void publish(bool known)
{
	const struct lp_demand computed = {.sh_order = 2, .max_lights = 4};
	struct lp_estimates estimates = {0};
	struct lp_light_estimate *e = &estimates.raw;
	const float half = (float)sqrt(0.5);

	e->t_capture_ns = e->t_arrival_ns = lp_clock_ns();
	e->cd_m2_per_unit = e->exposure_us = e->wheel_deg = e->wheel_sigma_deg = NAN;
	e->light_count = 1;
	e->lights[0] = (struct lp_light){.id = 1,
					 .direction = {0, 0, -1},
					 .irradiance = {1, 1, 1},
					 .direction_sigma_deg = 0.3F,
					 .distance_m = NAN};
	e->sh_total[2][1] = -1.0F; /* green grows towards -Z */
	e->orientation = (struct lp_estimate_orientation){.known = known,
							  .world = known,
							  .xyzw = {0, half, 0, half},
							  .sigma_deg = 0.4F};
	estimates.smoothed = estimates.raw;
	lp_hub_publish(hub, &estimates, &computed);
}

/* Lamps and coefficients together, or neither, and the packet says which. */
static void test_packets_in_the_world(void **state)
{
	const lightprobe_v1_Subscription wishes[] = {
		{.frame = lightprobe_v1_Estimate_Frame_WORLD,
		 .kind = lightprobe_v1_SphericalHarmonics_Kind_TOTAL},
		{.frame = lightprobe_v1_Estimate_Frame_WORLD,
		 .kind = lightprobe_v1_SphericalHarmonics_Kind_TOTAL,
		 .smoothing = lightprobe_v1_Subscription_Smoothing_RAW}};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(wishes); k++) {
		const lightprobe_v1_FromClient wish = {
			.which_message = lightprobe_v1_FromClient_subscribe_tag,
			.message.subscribe = wishes[k]};
		lightprobe_v1_Estimate e;

		assert_int_equal(request(&clients[0], &wish), 0);
		publish(true);
		e = last_estimate(&clients[0]);
		assert_int_equal(e.frame, lightprobe_v1_Estimate_Frame_WORLD);
		assert_float_equal(e.lights[0].direction[0], -1.0, 1e-6);
		assert_float_equal(e.lights[0].direction[2], 0.0, 1e-6);
		assert_float_equal(e.lights[0].direction_sigma_deg, 0.5, 1e-6);
		assert_float_equal(e.sh.coefficients[3 * 3 + 1], -1.0, 1e-6);
		assert_float_equal(e.sh.coefficients[3 * 2 + 1], 0.0, 1e-6);
		e = last_estimate(&clients[1]); /* who did not ask for it */
		assert_int_equal(e.frame, lightprobe_v1_Estimate_Frame_PROBE);
		assert_float_equal(e.lights[0].direction[2], -1.0, 1e-6);
		publish(false);
		e = last_estimate(&clients[0]);
		assert_int_equal(e.frame, lightprobe_v1_Estimate_Frame_PROBE);
		assert_float_equal(e.lights[0].direction[2], -1.0, 1e-6);
		assert_int_equal(e.orientation_count, 0);
		pass_ms(200);
	}
}

/* Two apps, two worlds: only that of the poses in use is given, and never to the other. */
static void test_one_client_at_a_time(void **state)
{
	const lightprobe_v1_FromClient wish = {
		.which_message = lightprobe_v1_FromClient_subscribe_tag,
		.message.subscribe = {.frame = lightprobe_v1_Estimate_Frame_WORLD}};

	(void)state;
	for (int i = 0; i < 2; i++)
		assert_int_equal(request(&clients[i], &wish), 0);
	assert_int_equal(send_pose(&clients[0], 1.0, 0), 0);
	assert_int_equal(send_pose(&clients[1], 1.0, 0), 0);
	assert_contains(last_error(&clients[1]), "another client");
	publish(true);
	assert_int_equal(last_estimate(&clients[0]).frame, lightprobe_v1_Estimate_Frame_WORLD);
	assert_int_equal(last_estimate(&clients[1]).frame, lightprobe_v1_Estimate_Frame_PROBE);
	leave(&clients[0]);
	pass_ms(500);
	assert_int_equal(send_pose(&clients[1], 1.0, 0), 0);
	assert_int_equal(request(&clients[1], &wish),
			 0); /* the last estimate is of another world */
	assert_int_equal(last_estimate(&clients[1]).frame, lightprobe_v1_Estimate_Frame_PROBE);
	publish(true);
	assert_int_equal(last_estimate(&clients[1]).frame, lightprobe_v1_Estimate_Frame_WORLD);
}

static void test_poses_that_nobody_wants(void **state)
{
	(void)teardown(state);
	assert_int_equal(setup_kind(LP_ORIENTATION_VISUAL), 0);
	assert_int_equal(send_pose(&clients[0], 1.0, 0), 0);
	assert_contains(last_error(&clients[0]), "--orientation=client");
	pass_ms(2000);
	lp_orientation_tick(&teller, lp_clock_ns());
	assert_int_equal(health.report.fault_count, 0);
}

/* Frames of a camera that does not know how it is turned. */
static void test_frames_that_carry_nothing(void **state)
{
	struct lp_frame frame = {.orientation = {NAN, NAN, NAN, NAN}};

	(void)teardown(state);
	assert_int_equal(setup_kind(LP_ORIENTATION_FRAMES), 0);
	for (int n = 0; n < 20; n++) {
		lp_orientation_frame(&teller, &frame);
		pass_ms(100);
		lp_orientation_tick(&teller, lp_clock_ns());
	}
	assert_true(has_fault("orientation-silent"));
	for (int i = 0; i < 4; i++)
		frame.orientation[i] = i == 3;
	lp_orientation_frame(&teller, &frame);
	lp_orientation_tick(&teller, lp_clock_ns());
	assert_false(has_fault("orientation-silent"));
}

/* The probe sits beside the head's origin, and goes around it as the head turns. */
static void test_where_the_probe_is(void **state)
{
	const float place_m[3] = {1.0F, 1.5F, -2.0F};
	struct lp_frame frame = {.t_read_ns = 0, .exposure_us = 8000.0F};

	(void)state;
	teller.mount.offset_m[2] = -0.1; /* before the forehead */
	head_m = place_m;
	assert_int_equal(send_pose(&clients[0], 90.0, 0), 0);
	pass_ms(10);
	assert_int_equal(send_pose(&clients[0], 90.0, 0), 0);
	head_m = NULL;
	frame.t_read_ns = lp_clock_ns() - LP_NS_PER_MS; /* exposed for 8 ms until then */
	lp_orientation_frame(&teller, &frame);
	assert_float_equal(frame.position_m[0], 1.0 - 0.1, 1e-6); /* to its left */
	assert_float_equal(frame.position_m[1], 1.5, 1e-6);
	assert_float_equal(frame.position_m[2], -2.0, 1e-6);
	assert_true(frame.position_sigma_m > 0.004F && frame.position_sigma_m < 0.02F);
	pass_ms(10);
	assert_int_equal(send_pose(&clients[0], 90.0, 0), 0);
	frame.t_read_ns = lp_clock_ns();
	lp_orientation_frame(&teller, &frame);
	assert_true(frame.position_sigma_m == 0.0F);
}

static void test_a_contradiction_is_told(void **state)
{
	struct lp_estimate_orientation orientation = {.left_out = true};

	(void)state;
	assert_int_equal(send_pose(&clients[0], 1.0, 0), 0);
	lp_orientation_judged(&teller, &orientation);
	assert_true(has_fault("orientation-contradicts"));
	orientation.left_out = false;
	lp_orientation_judged(&teller, &orientation);
	assert_false(has_fault("orientation-contradicts"));
	/* what the mount is off by adds to what is stated */
	teller.mount.sigma_rad = 0.3 * DEG;
	orientation = (struct lp_estimate_orientation){.world = true, .sigma_deg = 0.4F};
	lp_orientation_judged(&teller, &orientation);
	assert_float_equal(orientation.sigma_deg, 0.5, 1e-6);
}

/* What was wrong with a client's poses is nobody's fault when it has left; and whoever tells next
 * is another one. */
static void test_the_faults_of_a_client_go_with_it(void **state)
{
	struct lp_estimate_orientation orientation = {.left_out = true};
	struct lp_frame frame = {.t_read_ns = lp_clock_ns()};

	(void)state;
	for (int i = 0; i < 2; i++) {
		ping(&clients[i], false);
		pass_ms(10);
		ping(&clients[i], true);
	}
	assert_int_equal(send_pose(&clients[0], 1.0, 0), 0);
	lp_orientation_frame(&teller, &frame);
	const uint32_t first = frame.orientation_by;

	lp_orientation_judged(&teller, &orientation);
	for (int i = 0; i < 2; i++)
		assert_int_equal(send_pose(&clients[i], 1.0, 3600 * 1000), 0);
	assert_true(has_fault("orientation-contradicts") && has_fault("orientation-clock"));
	leave(&clients[0]);
	assert_false(has_fault("orientation-contradicts"));
	assert_true(has_fault("orientation-clock"));  /* of the other */
	lp_orientation_judged(&teller, &orientation); /* of a frame that was on its way */
	assert_false(has_fault("orientation-contradicts"));
	lp_orientation_frame(&teller, &frame);
	assert_int_not_equal(frame.orientation_by, first);
	leave(&clients[1]);
	assert_int_equal(health.report.fault_count, 0);
}

/* ---------------------------------------------------------------- a sensor */

static int setup_sensor(void **state)
{
	(void)state;
	return setup_kind(LP_ORIENTATION_SENSOR);
}

/* 30 degrees a second about Y, 100 times a second, with a sigma of 0.1 degrees a second. */
static void sense_for_ms(int ms)
{
	for (int t = 0; t < ms; t += 10) {
		const struct lp_orientation_sample sample = {.kind = LP_TURN_RATE,
							     .t_ns = lp_clock_ns(),
							     .rate_rad_s = {0, 30.0 * DEG, 0},
							     .sigma = 0.1 * DEG};

		lp_orientation_sensed(&teller, &sample);
		lp_orientation_tick(&teller, lp_clock_ns());
		pass_ms(10);
	}
}

static struct lp_frame frame_of(int age_ms)
{
	struct lp_frame frame = {.t_read_ns = lp_clock_ns() - age_ms * LP_NS_PER_MS};

	lp_orientation_frame(&teller, &frame);
	return frame;
}

/* Rates are added up; each frame is as uncertain as the turn since the one before. */
static void test_a_gyroscope_stamps_frames(void **state)
{
	(void)state;
	assert_true(isnan(frame_of(0).orientation[3]));
	sense_for_ms(500);
	const double before_deg = stamped_yaw_deg(20);

	sense_for_ms(1000);
	assert_float_equal(stamped_yaw_deg(20) - before_deg, 30.0, 0.05);
	sense_for_ms(100);
	const float soon_deg = frame_of(20).orientation_sigma_deg;

	sense_for_ms(1000);
	const float late_deg = frame_of(20).orientation_sigma_deg;

	assert_float_equal(soon_deg, 0.1 * 0.01 * sqrt(10), 0.001);
	assert_float_equal(late_deg, 0.1 * 0.01 * sqrt(100), 0.003);
	assert_int_equal(health.report.fault_count, 0);
	assert_int_equal(send_pose(&clients[0], 1.0, 4), 0); /* nobody wants poses now */
	assert_contains(last_error(&clients[0]), "--orientation=client");
}

static void test_a_sensor_that_falls_silent_is_told(void **state)
{
	const struct lp_orientation_sample bad = {.kind = LP_TURN_RATE,
						  .rate_rad_s = {NAN, 0, 0},
						  .sigma = 1};

	(void)state;
	sense_for_ms(300);
	assert_false(has_fault("orientation-silent"));
	for (int t = 0; t < 12; t++) {
		lp_orientation_sensed(&teller, &bad);
		pass_ms(100);
	}
	assert_true(isnan(frame_of(20).orientation[3]));
	lp_orientation_tick(&teller, lp_clock_ns());
	assert_true(has_fault("orientation-silent"));
	sense_for_ms(200);
	assert_false(has_fault("orientation-silent"));
	assert_false(isnan(frame_of(20).orientation[3]));
}

/* ---------------------------------------------------------------- the mount */

static int read_mount(const char *text, struct lp_mount *mount)
{
	char path[] = "/tmp/lp-mount-XXXXXX";
	const int fd = mkstemp(path);

	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), (ssize_t)strlen(text));
	close(fd);
	const int ret = lp_mount_read(path, mount);

	unlink(path);
	return ret;
}

static void test_mount_files(void **state)
{
	struct lp_mount mount;

	(void)state;
	assert_int_equal(read_mount("[mount]\nrotation_xyzw = 0, 0.6, 0, 0.8\nsigma_deg = 0.5\n",
				    &mount),
			 0);
	lp_orientation_init(&teller, LP_ORIENTATION_CLIENT, &mount, &health);
	turn_for_ms(&clients[0], 500, 0);
	assert_float_equal(stamped_yaw_deg(20), true_yaw_deg(20) + 2.0 * asin(0.6) / DEG, 0.01);
	assert_float_equal(mount.sigma_rad, 0.5 * DEG, 1e-9);
	assert_int_equal(read_mount("[mount]\nrotation_xyzw = 0, 0.6, 0, 0.8\n"
				    "offset_m = 0, 0.05, -0.1\n",
				    &mount),
			 0);
	assert_float_equal(mount.offset_m[2], -0.1, 1e-6);
	assert_int_equal(read_mount("[mount]\nrotation_xyzw = 0, 0, 0, 1\noffset_m = 1\n", &mount),
			 -EBADMSG);
	assert_int_equal(read_mount("[mount]\nrotation_xyzw = 0, 0.6, 0\n", &mount), -EBADMSG);
	assert_int_equal(read_mount("[mount]\nrotation_xyzw = 0, 0, 0, 0\n", &mount), -EBADMSG);
	assert_int_equal(read_mount("[mount]\nsigma_deg = 1\n", &mount), -EBADMSG);
	assert_int_equal(read_mount("[mount]\nyaw = 1\n", &mount), -EBADMSG);
	assert_int_equal(lp_mount_read("/nowhere/mount.ini", &mount), -ENOENT);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_frames_are_stamped_for_the_middle_of_their_exposure),
		TEST(test_poses_alone_tell_the_clock),
		TEST(test_poses_that_come_late_are_told),
		TEST(test_silence_is_told),
		TEST(test_poses_of_another_clock_are_refused),
		TEST(test_poses_overtaken_by_a_better_clock_are_nobodys_fault),
		TEST(test_what_is_no_rotation_is_refused),
		TEST(test_a_flood_is_bounded),
		TEST(test_packets_in_the_world),
		TEST(test_one_client_at_a_time),
		TEST(test_poses_that_nobody_wants),
		TEST(test_frames_that_carry_nothing),
		TEST(test_where_the_probe_is),
		TEST(test_a_contradiction_is_told),
		TEST(test_the_faults_of_a_client_go_with_it),
		TEST(test_mount_files),
		cmocka_unit_test_setup_teardown(test_a_gyroscope_stamps_frames, setup_sensor,
						teardown),
		cmocka_unit_test_setup_teardown(test_a_sensor_that_falls_silent_is_told,
						setup_sensor, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
