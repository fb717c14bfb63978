/* SPDX-License-Identifier: Apache-2.0 */
/* What the v4l2 source decides without a camera; with one: tests/kernel. */
#include "lp_test.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "base/clock.h"
#include "base/uri.h"
#include "camera_file_test.h"
#include "drivers/source/exposure_guess.h"
#include "drivers/source/v4l2/controls.h"
#include "drivers/source/v4l2/hotplug.h"
#include "drivers/source/v4l2/nodes.h"
#include "drivers/source/v4l2/offers.h"
#include "drivers/source/v4l2/settings.h"
#include "include/frame.h"

/* ---------------------------------------------------------------- which device */

static void test_device_names(void **state)
{
	struct lp_v4l2_target target;

	(void)state;
	assert_int_equal(lp_v4l2_target_parse("/dev/video0", &target), 0);
	assert_int_equal(target.kind, LP_V4L2_PATH);
	assert_int_equal(lp_v4l2_target_parse("usb-A_B_1-video-index0", &target), 0);
	assert_int_equal(target.kind, LP_V4L2_ID_NAME);
	assert_int_equal(lp_v4l2_target_parse("", &target), 0);
	assert_int_equal(target.kind, LP_V4L2_ANY);
	assert_int_equal(lp_v4l2_target_parse("2e1a:1000", &target), 0);
	assert_int_equal(target.kind, LP_V4L2_USB);
	assert_int_equal(target.usb.vendor, 0x2e1a);
	assert_int_equal(target.usb.product, 0x1000);
	assert_string_equal(target.serial, "");
	assert_int_equal(lp_v4l2_target_parse("2E1A:1000:AB:12", &target), 0);
	assert_string_equal(target.serial, "AB:12");
	assert_int_equal(lp_v4l2_target_parse("port:1-1.2", &target), 0);
	assert_int_equal(target.kind, LP_V4L2_PORT);
	assert_string_equal(target.port, "1-1.2");
	for (const char *const *bad =
		     (const char *const[]){"video0", "2e1a", "2e1a:10", "2e1a:1000x", "2e1:1000",
					   "12345:1000", "port:", "port:1-1/2",
					   "port:1-1.1.1.1.1.1.1.1.1.1.1.1.1.1.1.1", NULL};
	     *bad; bad++)
		assert_int_equal(lp_v4l2_target_parse(*bad, &target), -EINVAL);
}

static void make_folder(const char *format, const char *root)
{
	char command[512], path[256];

	snprintf(path, sizeof(path), format, root);
	snprintf(command, sizeof(command), "mkdir -p '%s'", path);
	assert_int_equal(system(command), 0); /* NOLINT(cert-env33-c) */
}

static void write_text(const char *folder, const char *name, const char *text)
{
	char path[512];
	FILE *file;

	snprintf(path, sizeof(path), "%s/%s", folder, name);
	file = fopen(path, "w");
	assert_non_null(file);
	fputs(text, file);
	assert_int_equal(fclose(file), 0);
}

/* A machine with one USB camera (two nodes) and one loop-back device. */
static void make_sysfs(const char *root)
{
	char path[256], target[512];

	make_folder("%s/class/video4linux", root);
	make_folder("%s/devices/usb1/1-2/1-2:1.0/video4linux/video0", root);
	make_folder("%s/devices/usb1/1-2/1-2:1.0/video4linux/video1", root);
	make_folder("%s/devices/virtual/video10", root);
	snprintf(path, sizeof(path), "%s/devices/usb1/1-2", root);
	write_text(path, "idVendor", "2e1a\n");
	write_text(path, "idProduct", "1000\n");
	write_text(path, "serial", "IXE 7\n");
	write_text(path, "manufacturer", "Insta360\n");
	write_text(path, "product", "Air  (rev/2)\n");
	write_text(path, "busnum", "1\n");
	write_text(path, "devnum", "9\n");
	for (int i = 0; i < 2; i++) {
		snprintf(path, sizeof(path), "%s/devices/usb1/1-2/1-2:1.0/video4linux/video%d",
			 root, i);
		write_text(path, "index", i ? "1\n" : "0\n");
		write_text(path, "name", "Insta360 Air\n");
		snprintf(target, sizeof(target), "%s/device", path);
		assert_int_equal(symlink("../..", target), 0);
		snprintf(target, sizeof(target), "%s/class/video4linux/video%d", root, i);
		assert_int_equal(symlink(path, target), 0);
	}
	snprintf(path, sizeof(path), "%s/devices/virtual/video10", root);
	write_text(path, "index", "0\n");
	write_text(path, "name", "Loop\n");
	snprintf(target, sizeof(target), "%s/class/video4linux/video10", root);
	assert_int_equal(symlink(path, target), 0);
}

static void test_nodes_of_a_machine(void **state)
{
	char root[] = "/tmp/lp-sysfs-XXXXXX", command[64];
	struct lp_v4l2_node nodes[LP_V4L2_MAX_NODES];

	(void)state;
	assert_non_null(mkdtemp(root));
	make_sysfs(root);
	assert_int_equal(lp_v4l2_nodes_read(root, nodes, LP_V4L2_MAX_NODES), 2);
	assert_string_equal(nodes[0].path, "/dev/video0");
	assert_string_equal(nodes[0].name, "Insta360 Air");
	assert_true(nodes[0].usb);
	assert_int_equal(nodes[0].vendor, 0x2e1a);
	assert_int_equal(nodes[0].product, 0x1000);
	assert_string_equal(nodes[0].serial, "IXE 7");
	assert_string_equal(nodes[0].port, "1-2");
	assert_int_equal(nodes[0].bus, 1);
	assert_int_equal(nodes[0].address, 9);
	assert_string_equal(nodes[0].id_name, "usb-Insta360_Air__rev_2__IXE_7-video-index0");
	assert_string_equal(nodes[1].path, "/dev/video10");
	assert_false(nodes[1].usb);
	assert_int_equal(lp_v4l2_nodes_read("/nonexistent", nodes, LP_V4L2_MAX_NODES), 0);
	snprintf(command, sizeof(command), "rm -r %s", root);
	assert_int_equal(system(command), 0); /* NOLINT(cert-env33-c) */
}

#define CAMERA(number, id, serial_text, port_text)                                             \
	{                                                                                      \
		.path = "/dev/video" #number, .name = "camera", .usb = true, .vendor = 0x1d6b, \
		.product = id, .serial = serial_text, .port = port_text,                       \
		.id_name = "usb-a_b_" serial_text "-video-index0",                             \
	}

static int select_by(const char *text, const struct lp_v4l2_node *nodes, int count,
		     const struct lp_v4l2_node *known, char *reason)
{
	struct lp_v4l2_target target;

	assert_int_equal(lp_v4l2_target_parse(text, &target), 0);
	return lp_v4l2_nodes_select(nodes, count, &target, known, reason, 512);
}

static void test_the_node_that_is_meant(void **state)
{
	const struct lp_v4l2_node nodes[] = {CAMERA(0, 0x0102, "A", "1-1"),
					     CAMERA(2, 0x0102, "B", "1-2")};
	char reason[512];

	(void)state;
	assert_int_equal(select_by("/dev/video2", nodes, 2, NULL, reason), 1);
	assert_int_equal(select_by("usb-a_b_A-video-index0", nodes, 2, NULL, reason), 0);
	assert_int_equal(select_by("1d6b:0102:B", nodes, 2, NULL, reason), 1);
	assert_int_equal(select_by("", nodes, 1, NULL, reason), 0);
	assert_int_equal(select_by("1d6b:0102", nodes, 2, NULL, reason), -ENOTUNIQ);
	assert_contains(reason, "several");
	assert_contains(reason, "1d6b:0102:B, port 1-2");
	assert_int_equal(select_by("1d6b:0103", nodes, 2, NULL, reason), -ENOENT);
	assert_contains(reason, "no such device; present: /dev/video0");
	assert_int_equal(select_by("", nodes, 0, NULL, reason), -ENOENT);
	assert_contains(reason, "no camera is present");
}

static void test_the_same_camera_again(void **state)
{
	const struct lp_v4l2_node was = CAMERA(0, 0x0102, "A", "1-1");
	const struct lp_v4l2_node decoy_and_moved[] = {CAMERA(0, 0x0102, "B", "1-1"),
						       CAMERA(2, 0x0102, "A", "2-1")};
	const struct lp_v4l2_node nameless = CAMERA(0, 0x0102, "", "1-1");
	const struct lp_v4l2_node another_model = CAMERA(0, 0x0103, "A", "1-1");
	const struct lp_v4l2_node twins[] = {CAMERA(2, 0x0102, "", "1-2"),
					     CAMERA(3, 0x0102, "", "1-1")};
	char reason[512];

	(void)state;
	/* By its serial number, wherever it is; not what took its node. */
	assert_int_equal(select_by("/dev/video0", decoy_and_moved, 2, &was, reason), 1);
	assert_int_equal(select_by("/dev/video0", decoy_and_moved, 1, &was, reason), -ENOENT);
	assert_contains(reason, "camera is unplugged; present: /dev/video0 (camera, 1d6b:0102:B");
	assert_contains(reason, "— replug it, or restart lightprobed to use another one");
	assert_int_equal(select_by("", &another_model, 1, &was, reason), -ENOENT);
	assert_contains(reason, "present: /dev/video0 (camera, 1d6b:0103:A");
	assert_int_equal(select_by("", NULL, 0, &was, reason), -ENOENT);
	assert_string_equal(reason, "camera is unplugged: waiting for it to come back");
	/* Without one, by its port; moved, only where there is no doubt. */
	assert_int_equal(select_by("", twins, 2, &nameless, reason), 1);
	assert_int_equal(select_by("", twins, 1, &nameless, reason), 0);
	assert_int_equal(select_by("", (struct lp_v4l2_node[]){twins[0], twins[0]}, 2, &nameless,
				   reason),
			 -ENOTUNIQ);
}

/* Cheap modules: one serial number for all of them. */
static void test_twins_are_told_apart_by_their_ports(void **state)
{
	const struct lp_v4l2_node both[] = {CAMERA(0, 0x0102, "A", "1-1.1"),
					    CAMERA(2, 0x0102, "A", "1-1.2")};
	struct lp_v4l2_node known = both[0];
	char reason[512];

	(void)state;
	assert_int_equal(select_by("port:1-1.2", both, 2, NULL, reason), 1);
	assert_int_equal(select_by("port:1-1.3", both, 2, NULL, reason), -ENOENT);
	assert_contains(reason, "1d6b:0102:A, port 1-1.2)");
	/* By what they have in common: both are named, and what to write. */
	assert_int_equal(select_by("1d6b:0102:A", both, 2, NULL, reason), -ENOTUNIQ);
	assert_contains(reason, "name one by its port, like v4l2:port:1-1.1");
	assert_contains(reason, "port 1-1.1)");
	/* When one is unplugged, the other is not taken for it: */
	assert_int_equal(select_by("port:1-1.1", &both[1], 1, &known, reason), -ENOENT);
	assert_contains(reason, "unplugged from port 1-1.1 — replug it there; present: /dev/v");
	assert_int_equal(select_by("/dev/v4l/by-path/x", &both[1], 1, &known, reason), -ENOENT);
	assert_int_equal(select_by("port:1-1.1", NULL, 0, &known, reason), -ENOENT);
	assert_contains(reason, "unplugged from port 1-1.1 — replug it there; no camera");
	known.has_twin = true; /* it was seen beside the other */
	assert_int_equal(select_by("/dev/video0", &both[1], 1, &known, reason), -ENOENT);
	assert_int_equal(select_by("/dev/video0", both, 2, &known, reason), 0);
}

/* ---------------------------------------------------------------- settings */

static int read_settings(const char *text, const char *profile, struct lp_v4l2_settings *settings,
			 struct lp_v4l2_target *target)
{
	struct lp_camera_file *file;
	struct lp_camera_profile camera;
	struct lp_uri uri;
	int ret;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	if (!profile)
		return lp_v4l2_settings_read(&uri, NULL, settings, target);
	ret = read_camera_file(profile, &file);
	if (ret < 0)
		return ret;
	camera = lp_camera_file_profile(file);
	ret = lp_v4l2_settings_read(&uri, &camera, settings, target);
	lp_camera_file_destroy(file);
	return ret;
}

static const char profile[] = "[camera]\n"
			      "name = Test\n"
			      "match = usb:2e1a:1000\n"
			      "projection = fisheye\n"
			      "width_px = 1472\n"
			      "height_px = 736\n"
			      "[v4l2]\n"
			      "format = mjpeg\n"
			      "fps = 30\n"
			      "exposure_delay_frames = 2\n"
			      "[lens.0]\n"
			      "cx_px = 1\n";

/* ---------------------------------------------------------------- events */

#define IS_NEWS(text) lp_v4l2_hotplug_is_news(text, sizeof(text) - 1)

static void test_events_of_the_kernel(void **state)
{
	(void)state;
	assert_true(IS_NEWS("add@/devices/x/video0\0ACTION=add\0DEVPATH=/devices/x/video0\0"
			    "SUBSYSTEM=video4linux\0MAJOR=81\0"));
	assert_true(IS_NEWS("change@/devices/x/video0\0ACTION=change\0SUBSYSTEM=video4linux"));
	assert_false(IS_NEWS("remove@/devices/x/video0\0ACTION=remove\0SUBSYSTEM=video4linux\0"));
	assert_false(IS_NEWS("add@/devices/x\0ACTION=add\0SUBSYSTEM=usb\0"));
	assert_false(IS_NEWS("add@/devices/SUBSYSTEM=video4linux"));
	assert_false(IS_NEWS("libudev"));
	assert_false(lp_v4l2_hotplug_is_news("", 0));
}

/* udevd's comes when the node has its permissions. */
static void test_events_of_udev(void **state)
{
	static const char properties[] = "DEVPATH=/devices/x/video0\0SUBSYSTEM=video4linux\0"
					 "ACTION=add\0";
	uint32_t numbers[8] = {0xfeedcafe, 40, 40, sizeof(properties)};
	char event[40 + sizeof(properties)] = "libudev";

	(void)state;
	memcpy(event + 8, numbers, sizeof(numbers));
	memcpy(event + 40, properties, sizeof(properties));
	assert_true(IS_NEWS(event));
	numbers[2] = UINT32_MAX; /* properties far beyond the event */
	memcpy(event + 8, numbers, sizeof(numbers));
	assert_false(IS_NEWS(event));
}

static void test_settings_of_a_camera_file(void **state)
{
	struct lp_v4l2_settings settings;
	struct lp_v4l2_target target;

	(void)state;
	assert_int_equal(read_settings("v4l2:", profile, &settings, &target), 0);
	assert_int_equal(target.kind, LP_V4L2_USB);
	assert_int_equal(target.usb.vendor, 0x2e1a);
	assert_int_equal(settings.wish.size_px.width, 1472);
	assert_int_equal(settings.wish.size_px.height, 736);
	assert_int_equal(settings.wish.format, LP_FORMAT_MJPEG);
	assert_int_equal(settings.exposure_delay_frames, 2);
	assert_float_equal(settings.stall_ms, 1000, 0);
	/* The URI has the last word. */
	assert_int_equal(read_settings("v4l2:/dev/video3?fps=15&format=auto", profile, &settings,
				       &target),
			 0);
	assert_int_equal(target.kind, LP_V4L2_PATH);
	assert_int_equal(settings.wish.format, 0);
	assert_float_equal(settings.wish.fps, 15, 0);
	assert_int_equal(settings.exposure_delay_frames, 2);
}

static void test_faults_in_settings_are_located(void **state)
{
	struct lp_v4l2_settings settings;
	struct lp_v4l2_target target;
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(read_settings("v4l2:video0", NULL, &settings, &target), -EINVAL);
	assert_int_equal(read_settings("v4l2:?speed=1", NULL, &settings, &target), -EINVAL);
	assert_int_equal(read_settings("v4l2:", "[v4l2]\n\nfps = fast\n", &settings, &target),
			 -EBADMSG);
	assert_int_equal(read_settings("v4l2:", "[camera]\nmatch = usb:12:1\n", &settings, &target),
			 -EBADMSG);
	assert_int_equal(read_settings("v4l2:", "[v4l2]\nfps\n", &settings, &target), -EBADMSG);
	capture_end(&capture);
	assert_contains(capture.text, "'video0' is not the name of a camera");
	assert_contains(capture.text, "speed: unknown key; known: format, size");
	assert_contains(capture.text, ":3: fps");
	assert_contains(capture.text, ":2: match");
	assert_contains(capture.text, ":2: parse: neither NAME = VALUE");
}

/* ---------------------------------------------------------------- negotiation */

static const struct lp_offers offers = {
	.count = 5,
	.list = {{.fourcc = V4L2_PIX_FMT_YUYV,
		  .width_px = 1920,
		  .height_px = 960,
		  .rate_count = 1,
		  .rates_hz = {5}},
		 {.fourcc = V4L2_PIX_FMT_MJPEG,
		  .width_px = 3840,
		  .height_px = 1920,
		  .rate_count = 1,
		  .rates_hz = {30}},
		 {.fourcc = V4L2_PIX_FMT_MJPEG,
		  .width_px = 1920,
		  .height_px = 960,
		  .rate_count = 3,
		  .rates_hz = {60, 29.97F, 15}},
		 {.fourcc = V4L2_PIX_FMT_MJPEG, .width_px = 640, .height_px = 320},
		 {.fourcc = V4L2_PIX_FMT_H264, .width_px = 1920, .height_px = 960}},
};

static int choose(struct lp_offer_wish wish, struct lp_offer_choice *choice)
{
	return lp_offers_choose(&offers, &wish, choice);
}

static void test_choice_of_format(void **state)
{
	struct lp_offer_choice choice;

	(void)state;
	assert_int_equal(choose((struct lp_offer_wish){0}, &choice), 0);
	assert_int_equal(choice.format, LP_FORMAT_MJPEG);
	assert_int_equal(choice.width_px, 1920);
	assert_float_equal(choice.rate_hz, 29.97, 1e-4);
	assert_int_equal(choose((struct lp_offer_wish){.format = LP_FORMAT_YUYV}, &choice), 0);
	assert_int_equal(choice.fourcc, V4L2_PIX_FMT_YUYV);
	assert_int_equal(choose((struct lp_offer_wish){.size_px = {3840, 1920}}, &choice), 0);
	assert_int_equal(choice.height_px, 1920);
	assert_int_equal(choose((struct lp_offer_wish){.fps = 30, .size_px = {1920, 960}}, &choice),
			 0);
	assert_float_equal(choice.rate_hz, 29.97, 1e-4);
	/* A rate that the driver does not list is left to it. */
	assert_int_equal(choose((struct lp_offer_wish){.fps = 25, .size_px = {640, 320}}, &choice),
			 0);
	assert_float_equal(choice.rate_hz, 25, 0);
	assert_int_equal(choose((struct lp_offer_wish){.format = LP_FORMAT_NV12}, &choice),
			 -EINVAL);
	assert_int_equal(choose((struct lp_offer_wish){.size_px = {800, 400}}, &choice), -EINVAL);
	assert_int_equal(choose((struct lp_offer_wish){.fps = 20, .size_px = {1920, 960}}, &choice),
			 -EINVAL);
}

static void test_choice_in_a_range_of_sizes(void **state)
{
	const struct lp_offers range = {.count = 1,
					.list = {{.fourcc = V4L2_PIX_FMT_GREY,
						  .width_px = 1280,
						  .height_px = 720,
						  .least_width_px = 16,
						  .least_height_px = 16,
						  .step_width_px = 4,
						  .step_height_px = 2}}};
	struct lp_offer_wish wish = {.size_px = {640, 320}};
	struct lp_offer_choice choice;

	(void)state;
	assert_int_equal(lp_offers_choose(&range, &wish, &choice), 0);
	assert_int_equal(choice.width_px, 640);
	wish.size_px.width = 642;
	assert_int_equal(lp_offers_choose(&range, &wish, &choice), -EINVAL);
	wish.size_px.width = 1284;
	assert_int_equal(lp_offers_choose(&range, &wish, &choice), -EINVAL);
	wish.size_px = (struct lp_size){0};
	assert_int_equal(lp_offers_choose(&range, &wish, &choice), 0);
	assert_int_equal(choice.width_px, 1280);
}

static void test_choice_in_a_range_of_rates(void **state)
{
	const struct lp_offers range = {.count = 1,
					.list = {{.fourcc = V4L2_PIX_FMT_GREY,
						  .width_px = 640,
						  .height_px = 320,
						  .rate_count = 2,
						  .rates_are_range = true,
						  .rates_hz = {120, 5}}}};
	static const struct {
		float wanted_hz, chosen_hz; /* 0: not offered */
	} cases[] = {{25, 25}, {5, 5}, {120, 120}, {120.5F, 120}, {4, 0}, {130, 0}, {0, 30}};
	struct lp_offer_choice choice;
	char text[64];

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		const struct lp_offer_wish wish = {.fps = cases[i].wanted_hz};
		const int ret = lp_offers_choose(&range, &wish, &choice);

		assert_int_equal(ret, cases[i].chosen_hz > 0 ? 0 : -EINVAL);
		if (ret == 0)
			assert_float_equal(choice.rate_hz, cases[i].chosen_hz, 1e-4);
	}
	lp_offers_describe(&range, text, sizeof(text));
	assert_string_equal(text, "GREY 640x320 at 120 to 5");
}

static void test_offers_in_words(void **state)
{
	char text[256], little[40];

	(void)state;
	lp_offers_describe(&offers, text, sizeof(text));
	assert_string_equal(text,
			    "YUYV 1920x960 at 5; MJPG 3840x1920 at 30, 1920x960 at 60/29.97/15, "
			    "640x320; H264 1920x960");
	lp_offers_describe(&offers, little, sizeof(little));
	assert_string_equal(little, "YUYV 1920x960 at 5 ...");
	lp_offers_describe(&(struct lp_offers){0}, text, sizeof(text));
	assert_string_equal(text, "nothing");

	struct lp_offer_wish wish = {.format = LP_FORMAT_YUYV, .fps = 30};

	lp_offers_refuse(&offers, &wish, text, sizeof(text));
	assert_string_equal(text, "YUYV at 30 is not offered — there is YUYV 1920x960 at 5");
	wish.format = LP_FORMAT_GREY;
	lp_offers_refuse(&offers, &wish, text, sizeof(text));
	assert_memory_equal(text, "GREY at 30 is not offered — there is YUYV 1920x960 at 5; MJPG",
			    60);
	wish.format = 0;
	lp_offers_refuse(&offers, &wish, text, sizeof(text));
	assert_memory_equal(text, "any format at 30 is not offered — there is YUYV", 49);
}

static void test_sizes_of_pictures(void **state)
{
	(void)state;
	assert_int_equal(lp_row_bytes(LP_FORMAT_YUYV, 640), 1280);
	assert_int_equal(lp_row_bytes(LP_FORMAT_MJPEG, 640), 0);
	assert_int_equal(lp_picture_bytes(LP_FORMAT_NV12, 640, 320), 640 * 480);
	assert_int_equal(lp_picture_bytes(LP_FORMAT_GREY, 640, 320), 640 * 320);
}

/* ---------------------------------------------------------------- exposure */

static void test_values_become_control_values(void **state)
{
	const struct lp_v4l2_range range = {.minimum = 3, .maximum = 100, .step = 10};

	(void)state;
	assert_int_equal(lp_v4l2_to_control(0, &range), 3);
	assert_int_equal(lp_v4l2_to_control(NAN, &range), 3);
	assert_int_equal(lp_v4l2_to_control(7.9, &range), 3);
	assert_int_equal(lp_v4l2_to_control(8.1, &range), 13);
	assert_int_equal(lp_v4l2_to_control(99, &range), 93);
	assert_int_equal(lp_v4l2_to_control(1e30, &range), 100);
	assert_int_equal(lp_v4l2_to_control(42, &(struct lp_v4l2_range){0, 255, 0}), 42);
}

/* Exposures of frames 0.. at 10 ms, with a change from 100 to 800 us commanded during frame 4. */
static void guess_frames(int delay_frames, float *exposures_us, int count)
{
	struct lp_exposure_guess guess;

	lp_exposure_guess_init(&guess, delay_frames);
	guess.exposure_us = 100;
	guess.gain = 1;
	for (int i = 0; i < count; i++) {
		struct lp_frame frame = {.sequence = 70 + (uint64_t)i,
					 .t_read_ns = (i + 1) * 10 * LP_NS_PER_MS};

		lp_exposure_guess_frame(&guess, &frame);
		exposures_us[i] = frame.exposure_us;
		if (i == 4)
			lp_exposure_guess_command(&guess, 800, 1, frame.t_read_ns + LP_NS_PER_MS);
	}
}

static void test_frames_around_a_change_are_unknown(void **state)
{
	static const struct {
		int delay_frames, last_old, first_new;
	} cases[] = {{0, 4, 6}, {1, 4, 7}, {2, 5, 8}, {4, 7, 10}, {-1, 4, 11}};
	float exposures_us[16];

	(void)state;
	for (size_t c = 0; c < LP_COUNT(cases); c++) {
		guess_frames(cases[c].delay_frames, exposures_us, 16);
		for (int i = 0; i < 16; i++) {
			if (i <= cases[c].last_old)
				assert_float_equal(exposures_us[i], 100, 0);
			else if (i >= cases[c].first_new)
				assert_float_equal(exposures_us[i], 800, 0);
			else
				assert_true(isnan(exposures_us[i]));
		}
	}
}

static void test_a_second_change_before_the_first_has_landed(void **state)
{
	struct lp_exposure_guess guess;
	struct lp_frame frame = {.sequence = 1, .t_read_ns = 10 * LP_NS_PER_MS};

	(void)state;
	lp_exposure_guess_init(&guess, 2);
	guess.exposure_us = 100;
	lp_exposure_guess_command(&guess, 200, 1, 5 * LP_NS_PER_MS);
	lp_exposure_guess_command(&guess, 400, 1, 6 * LP_NS_PER_MS);
	lp_exposure_guess_frame(&guess, &frame);
	assert_true(isnan(frame.exposure_us));
	frame = (struct lp_frame){.sequence = 4, .t_read_ns = 40 * LP_NS_PER_MS};
	lp_exposure_guess_frame(&guess, &frame);
	assert_float_equal(frame.exposure_us, 400, 0);
}

/* What is answered late may have taken effect at any time: it stays unknown for so much longer. */
static void test_a_command_that_is_answered_late(void **state)
{
	struct lp_exposure_guess guess;
	struct lp_frame frame;

	(void)state;
	lp_exposure_guess_init(&guess, -1);
	guess.exposure_us = 100;
	guess.longest_frames = 3;
	lp_exposure_guess_command(&guess, 200, 1, 5 * LP_NS_PER_MS);
	for (unsigned k = 1; k <= 10; k++) {
		if (k == 3)
			lp_exposure_guess_late(&guess, 25 * LP_NS_PER_MS);
		frame = (struct lp_frame){.sequence = k, .t_read_ns = k * 10 * LP_NS_PER_MS};
		lp_exposure_guess_frame(&guess, &frame);
		/* frame 3 is the first one after the answer; three more may still lack it */
		assert_true(isnan(frame.exposure_us) == (k <= 6));
	}
	assert_float_equal(frame.exposure_us, 200, 0);
	lp_exposure_guess_late(&guess, 200 * LP_NS_PER_MS); /* settled: nothing is in doubt */
	lp_exposure_guess_frame(&guess, &frame);
	assert_float_equal(frame.exposure_us, 200, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_device_names),
		cmocka_unit_test(test_nodes_of_a_machine),
		cmocka_unit_test(test_the_node_that_is_meant),
		cmocka_unit_test(test_the_same_camera_again),
		cmocka_unit_test(test_twins_are_told_apart_by_their_ports),
		cmocka_unit_test(test_events_of_the_kernel),
		cmocka_unit_test(test_events_of_udev),
		cmocka_unit_test(test_settings_of_a_camera_file),
		cmocka_unit_test(test_faults_in_settings_are_located),
		cmocka_unit_test(test_choice_of_format),
		cmocka_unit_test(test_choice_in_a_range_of_sizes),
		cmocka_unit_test(test_choice_in_a_range_of_rates),
		cmocka_unit_test(test_offers_in_words),
		cmocka_unit_test(test_sizes_of_pictures),
		cmocka_unit_test(test_values_become_control_values),
		cmocka_unit_test(test_frames_around_a_change_are_unknown),
		cmocka_unit_test(test_a_second_change_before_the_first_has_landed),
		cmocka_unit_test(test_a_command_that_is_answered_late),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
