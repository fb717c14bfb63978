/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/options/options.h"

static struct lp_options options;

static int read_line(const char *first, const char *second, const char *third)
{
	char *argv[] = {"lightprobed", (char *)first, (char *)second, (char *)third, NULL};
	int argc = 1;

	while (argv[argc])
		argc++;
	return lp_options_read(&options, argc, argv);
}

static int read_config(const char *text)
{
	lp_options_defaults(&options);
	return lp_options_read_config(&options, "probe.conf", text, strlen(text));
}

static void test_defaults(void **state)
{
	(void)state;
	setenv("XDG_RUNTIME_DIR", "/run/user/7", 1);
	assert_int_equal(read_line("--source=file:a.jpg", NULL, NULL), 0);
	assert_string_equal(options.source.texts[0], "file:a.jpg");
	assert_string_equal(lp_options_camera(&options, 0), "equirect");
	assert_int_equal(options.preset, LP_PRESET_BALANCED);
	assert_int_equal(options.detector.detector, LP_DETECTOR_ADAPTIVE);
	assert_int_equal(options.sh_order, 4);
	assert_int_equal(options.lights, 8);
	assert_false(options.once);
	assert_int_equal(options.publish.count, 2);
	assert_string_equal(options.publish.texts[0], "tcp:127.0.0.1:7700");
	assert_string_equal(options.publish.texts[1], "unix:/run/user/7/lightprobe.sock");
	unsetenv("XDG_RUNTIME_DIR");
	assert_int_equal(read_line(NULL, NULL, NULL), 0);
	assert_string_equal(options.publish.texts[1], "unix:/run/lightprobe/lightprobe.sock");
}

static void test_once_publishes_to_stdout(void **state)
{
	(void)state;
	assert_int_equal(read_line("--once", NULL, NULL), 0);
	assert_int_equal(options.publish.count, 1);
	assert_string_equal(options.publish.texts[0], "stdout:");
	assert_int_equal(read_line("--once", "--publish=tcp:[::1]:1", NULL), 0);
	assert_string_equal(options.publish.texts[0], "tcp:[::1]:1");
}

static void test_both_ways_to_give_a_value(void **state)
{
	(void)state;
	assert_int_equal(read_line("--sh-order", "1", "--lights=0"), 0);
	assert_int_equal(options.sh_order, 1);
	assert_int_equal(options.lights, 0);
	assert_int_equal(read_line("--publish=stdout:", "--publish", "unix:/a"), 0);
	assert_int_equal(options.publish.count, 2);
}

static void test_knobs_of_a_preset(void **state)
{
	(void)state;
	assert_int_equal(read_line("--decode=blocks", "--exact-blocks=0", "--refine-cells=7"), 0);
	assert_int_equal(options.decode_divisor, LP_DECODE_BY_BLOCKS);
	assert_int_equal(options.exact_blocks, LP_NONE);
	assert_int_equal(options.refine_cells, 7);
	assert_int_equal(read_line("--decode=pixels", "--exact-blocks=preset", NULL), 0);
	assert_int_equal(options.decode_divisor, 1);
	assert_int_equal(options.exact_blocks, 0);
	assert_int_equal(options.refine_cells, 0);
	assert_int_equal(read_config("decode = blocks\nexact-blocks = 9\nrefine-cells = 0\n"
				     "latency-goal-ms = 12.5\ncpu-budget-percent = 80\n"),
			 0);
	assert_int_equal(options.exact_blocks, 9);
	assert_int_equal(options.refine_cells, LP_NONE);
	assert_true(options.goals.latency_ms == 12.5F);
	assert_true(options.goals.cpu_percent == 80.0F);
}

static void test_detectors(void **state)
{
	static const char *const bad[] = {"--detector=",
					  "--detector=adaptive:1",
					  "--detector=other",
					  "--detector=mediancut:4",
					  "--detector=research:",
					  "--detector=research:0",
					  "--detector=research:nan",
					  "--detector=research:1x"};

	(void)state;
	assert_int_equal(read_line("--detector=research", NULL, NULL), 0);
	assert_int_equal(options.detector.detector, LP_DETECTOR_RESEARCH);
	assert_true(options.detector.threshold == 0.0F); /* the median */
	assert_int_equal(read_line("--detector=research:0.5", NULL, NULL), 0);
	assert_int_equal(options.detector.detector, LP_DETECTOR_RESEARCH);
	assert_true(options.detector.threshold == 0.5F);
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		if (read_line(bad[i], NULL, NULL) != -EINVAL)
			fail_msg("%s was accepted", bad[i]);
	}
}

static void test_bad_command_lines(void **state)
{
	static const char *const bad[] = {"--soruce=file:a",
					  "file:a.jpg",
					  "-s",
					  "--",
					  "--sh-order=5",
					  "--sh-order=2.5",
					  "--lights=9",
					  "--preset=slow",
					  "--panorama-width=241",
					  "--panorama-width=8",
					  "--decode=3",
					  "--decode=block",
					  "--exact-blocks=-1",
					  "--exact-blocks=65537",
					  "--exact-blocks=",
					  "--refine-cells=1025",
					  "--refine-cells=many",
					  "--latency-goal-ms=-1",
					  "--cpu-budget-percent=nan",
					  "--wheel-angles=nan",
					  "--wheel-angles=0,181",
					  "--wheel-angles=-1",
					  "--decode=",
					  "--smoothing-ms=-1",
					  "--ttl-ms=0",
					  "--log-level=loud",
					  "--source",
					  "--once=maybe",
					  "--max-clients=0",
					  "--config=/nowhere",
					  "--publish=",
					  "--exposure-us=-1",
					  "--=1",
					  "--panorama-width=",
					  "--a-name-that-is-much-too-long-for-any=1"};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		struct capture capture;
		int ret;

		capture_begin(&capture);
		ret = read_line(bad[i], NULL, NULL);
		lp_log_flush(1); /* the same option again is only counted */
		capture_end(&capture);
		if (ret >= 0)
			fail_msg("%s was accepted", bad[i]);
		assert_contains(capture.text, "error ");
	}
}

static void test_config_file_form(void **state)
{
	(void)state;
	assert_int_equal(read_config("# a comment\n"
				     "\n"
				     "source = sim:/run/sim.sock\n"
				     "  sh-order=1   ; a remark\n"
				     "publish = stdout:\n"
				     "publish = tcp:0.0.0.0:7700\n"
				     "smoothing-ms = 0\r\n"
				     "lights: 3"),
			 0);
	assert_string_equal(options.source.texts[0], "sim:/run/sim.sock");
	assert_int_equal(options.sh_order, 1);
	assert_int_equal(options.lights, 3);
	assert_true(options.smoothing_ms == 0);
	assert_int_equal(options.publish.count, 2);
}

static void test_several_cameras(void **state)
{
	(void)state;
	assert_int_equal(read_config("source = sim:/run/a\n"
				     "source = sim:/run/b\n"
				     "camera = front.camera\n"
				     "camera = back.camera\n"),
			 0);
	assert_int_equal(options.source.count, 2);
	assert_string_equal(options.source.texts[1], "sim:/run/b");
	assert_string_equal(lp_options_camera(&options, 0), "front.camera");
	assert_string_equal(lp_options_camera(&options, 1), "back.camera");
	assert_int_equal(read_line("--source=file:a", "--source=file:b", NULL), 0);
	assert_int_equal(options.source.count, 2);
	assert_string_equal(lp_options_camera(&options, 1), "equirect");
	assert_int_equal(read_line("--source=", NULL, NULL), -EINVAL);
}

static void test_config_errors_name_file_and_line(void **state)
{
	static const struct {
		const char *text, *message;
	} cases[] = {
		{"\n\nlihgts = 3\n", "error probe.conf:3: lihgts: unknown key; known: source, "},
		{"lights = 12\n", "error probe.conf:1: lights: '12' is not a whole number 0..8\n"},
		{"lights = 2\nnonsense\n", "error probe.conf:2: parse: neither NAME = VALUE"},
		{"[probe]\nlights = 2\n",
		 "error probe.conf:2: parse: unknown section [probe]; known: (none)"},
		{"once = 1\n", "error probe.conf:1: once: unknown key"},
		{"config = other\n", "error probe.conf:1: config: unknown key"},
	};
	char longer[400] = "source = file:";
	struct capture capture;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		capture_begin(&capture);
		assert_int_equal(read_config(cases[i].text), -EBADMSG);
		capture_end(&capture);
		assert_contains(capture.text, cases[i].message);
	}
	memset(longer + strlen(longer), 'x', sizeof(longer) - strlen(longer) - 1);
	capture_begin(&capture);
	assert_int_equal(read_config(longer), -EBADMSG);
	capture_end(&capture);
	assert_contains(capture.text, "error probe.conf:1: parse: a line has at most 198 bytes");
}

static void test_command_line_wins_over_file(void **state)
{
	char path[] = "/tmp/lp-options-XXXXXX", argument[64];
	const char *text = "lights = 3\nsh-order = 1\npublish = stdout:\npublish = unix:/x\n";
	const int fd = mkstemp(path);

	(void)state;
	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), strlen(text));
	close(fd);
	(void)snprintf(argument, sizeof(argument), "--config=%s", path);
	assert_int_equal(read_line("--lights=5", argument, NULL), 0);
	assert_int_equal(options.lights, 5);
	assert_int_equal(options.sh_order, 1);
	assert_int_equal(options.publish.count, 2);
	assert_int_equal(read_line("--publish=tcp:[::1]:7", argument, NULL), 0);
	assert_int_equal(options.publish.count, 1);
	assert_string_equal(options.publish.texts[0], "tcp:[::1]:7");
	unlink(path);
}

/* Those that a running daemon does not use. */
static const char *const once_names[] = {"--area-lights", "--key-light",	 "--ring-lux",
					 "--ring-rgb",	  "--ring-colour-sigma", "--ring-sigma"};

static void test_help_names_every_option(void **state)
{
	static const char *const names[] = {
		"--source",	  "--publish",	"--camera",   "--preset",    "--panorama-width",
		"--decode",	  "--detector", "--sh-order", "--lights",    "--smoothing-ms",
		"--ttl-ms",	  "--config",	"--once",     "--log-level", "--version",
		"--check-config", "--help"};
	char *text = NULL;
	size_t size;
	FILE *out = open_memstream(&text, &size);

	(void)state;
	lp_options_help(out);
	fclose(out);
	for (size_t i = 0; i < LP_COUNT(names); i++)
		assert_contains(text, names[i]);
	for (size_t i = 0; i < LP_COUNT(once_names); i++)
		assert_null(strstr(text, once_names[i]));
	free(text);
}

static void test_options_of_pictures_have_a_help_of_their_own(void **state)
{
	char *text = NULL;
	size_t size;
	FILE *out = open_memstream(&text, &size);

	(void)state;
	lp_options_help_once(out);
	fclose(out);
	for (size_t i = 0; i < LP_COUNT(once_names); i++)
		assert_contains(text, once_names[i]);
	free(text);
}

static void test_options_of_pictures_need_once(void **state)
{
	static const char lux[] = "--ring-lux=1,2,3,4,nan,6,7,8,9";
	struct capture capture;

	(void)state;
	assert_int_equal(read_line("--once", "--area-lights", lux), 0);
	assert_true(options.area_lights);
	assert_int_equal(options.ring_lux.count, 9);
	assert_int_equal(read_line("--key-light", "--once", NULL), 0);
	assert_true(options.key_light);
	capture_begin(&capture);
	assert_int_equal(read_line("--source=file:a.jpg", lux, NULL), -EINVAL);
	capture_end(&capture);
	assert_contains(capture.text, "--ring-lux: belongs to pictures");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_defaults),
		cmocka_unit_test(test_once_publishes_to_stdout),
		cmocka_unit_test(test_both_ways_to_give_a_value),
		cmocka_unit_test(test_knobs_of_a_preset),
		cmocka_unit_test(test_detectors),
		cmocka_unit_test(test_bad_command_lines),
		cmocka_unit_test(test_config_file_form),
		cmocka_unit_test(test_several_cameras),
		cmocka_unit_test(test_config_errors_name_file_and_line),
		cmocka_unit_test(test_command_line_wins_over_file),
		cmocka_unit_test(test_help_names_every_option),
		cmocka_unit_test(test_options_of_pictures_have_a_help_of_their_own),
		cmocka_unit_test(test_options_of_pictures_need_once),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
