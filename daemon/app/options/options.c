/* SPDX-License-Identifier: Apache-2.0 */
#include "app/options/options.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app/options/once_options.h"
#include "base/ini.h"
#include "base/param.h"
#include "base/text.h"

/* As enum lp_orientation_kind. */
static const char *const orientations[] = {"none", "visual", "sim", "client", "sensor"};
static const char *const presets[] = {"fast", "balanced", "accurate", "reference", NULL};
static const char *const log_levels[] = {"error", "warning", "info", "debug", NULL};

const char *lp_orientation_name(int orientation)
{
	return orientations[orientation];
}

const char *lp_preset_name(int preset)
{
	return presets[preset];
}

/* ---------------------------------------------------------------- values with a form of their own
 */

static int parse_publish(const char *text, void *field)
{
	struct lp_uri_texts *list = field;

	const size_t length = strlen(text);

	if (list->count == LP_MAX_PUBLISHERS || length == 0 || length >= LP_URI_MAX_BYTES)
		return -EINVAL;
	memcpy(list->texts[list->count++], text, length + 1);
	return 0;
}

static int add_text(struct lp_camera_texts *list, const char *text)
{
	const size_t length = strlen(text);

	if (list->count == LP_MAX_CAMERAS || length == 0 || length >= LP_URI_MAX_BYTES)
		return -EINVAL;
	memcpy(list->texts[list->count++], text, length + 1);
	return 0;
}

static int parse_camera(const char *text, void *field)
{
	return add_text(field, text);
}

static int parse_width(const char *text, void *field)
{
	char *end;
	const long width = strtol(text, &end, 10);

	if (end == text || *end || (width != 0 && (width < 16 || width > 960 || width % 8)))
		return -EINVAL;
	*(int *)field = (int)width;
	return 0;
}

static int parse_decode(const char *text, void *field)
{
	int *divisor = field;

	if (strcmp(text, "blocks") == 0)
		*divisor = LP_DECODE_BY_BLOCKS;
	else if (strcmp(text, "pixels") == 0)
		*divisor = 1;
	else if (strlen(text) == 1 && strchr("01248", text[0]))
		*divisor = text[0] - '0';
	else
		return -EINVAL;
	return 0;
}

/* `preset` is 0, and 0 is LP_NONE. */
static int parse_count(const char *text, int most, int *count)
{
	char *end;
	const long number = strtol(text, &end, 10);

	if (strcmp(text, "preset") == 0) {
		*count = 0;
		return 0;
	}
	if (end == text || *end || number < 0 || number > most)
		return -EINVAL;
	*count = number ? (int)number : LP_NONE;
	return 0;
}

static int parse_exact_blocks(const char *text, void *field)
{
	return parse_count(text, LP_MOST_EXACT_BLOCKS, field);
}

static int parse_refine_cells(const char *text, void *field)
{
	return parse_count(text, LP_MOST_REFINE_CELLS, field);
}

static int parse_reflection_size(const char *text, void *field)
{
	int *const size = field;

	*size = strcmp(text, "16") == 0	  ? 16
		: strcmp(text, "32") == 0 ? 32
		: strcmp(text, "64") == 0 ? 64
					  : 0;
	return *size || strcmp(text, "off") == 0 ? 0 : -EINVAL;
}

static int parse_orientation(const char *text, void *field)
{
	struct lp_orientation_choice *choice = field;

	if (strchr(text, ':')) {
		if (strlen(text) >= sizeof(choice->uri))
			return -EINVAL;
		choice->kind = LP_ORIENTATION_SENSOR;
		lp_text_copy(choice->uri, sizeof(choice->uri), text);
		return 0;
	}
	if (strcmp(text, "frames") == 0) /* Hello names it "sim", as before recordings had poses */
		text = lp_orientation_name(LP_ORIENTATION_FRAMES);
	for (int k = 0; k < LP_ORIENTATION_SENSOR; k++) {
		if (strcmp(text, orientations[k]) == 0) {
			choice->kind = (enum lp_orientation_kind)k;
			return 0;
		}
	}
	return -EINVAL;
}

/* adaptive, research, or research:RADIANCE. */
static int parse_detector(const char *text, void *field)
{
	struct lp_detector_options *choice = field;
	char *end;

	*choice = (struct lp_detector_options){.detector = LP_DETECTOR_ADAPTIVE};
	if (strcmp(text, "adaptive") == 0)
		return 0;
	choice->detector = LP_DETECTOR_RESEARCH;
	if (strcmp(text, "research") == 0)
		return 0;
	if (strncmp(text, "research:", 9) != 0 || !text[9])
		return -EINVAL;
	choice->threshold = strtof(text + 9, &end);
	return *end || !isfinite(choice->threshold) || choice->threshold <= 0 ? -EINVAL : 0;
}

/* 0, or 1..2 */
static int parse_index(const char *text, void *field)
{
	float *index = field;
	char *end;

	*index = strtof(text, &end);
	return end == text || *end || (*index != 0.0F && !(*index >= 1.0F && *index <= 2.0F))
		       ? -EINVAL
		       : 0;
}

/* off, sweep, films, or fixed:DEG. */
static int parse_polarizer(const char *text, void *field)
{
	struct lp_polarizer *polarizer = field;
	char *end;

	*polarizer = (struct lp_polarizer){.mode = LP_POLARIZER_OFF};
	if (strcmp(text, "off") == 0)
		return 0;
	polarizer->mode = LP_POLARIZER_SWEEP;
	if (strcmp(text, "sweep") == 0)
		return 0;
	polarizer->mode = LP_POLARIZER_FILMS;
	if (strcmp(text, "films") == 0)
		return 0;
	if (strncmp(text, "fixed:", 6) != 0 || !text[6])
		return -EINVAL;
	polarizer->mode = LP_POLARIZER_FIXED;
	polarizer->fixed_deg = strtof(text + 6, &end);
	return *end || !(polarizer->fixed_deg >= 0.0F && polarizer->fixed_deg <= 180.0F) ? -EINVAL
											 : 0;
}

/* ---------------------------------------------------------------- the table */

static const struct lp_param config_list[] = {
	{"source", LP_PARAM_OWN, offsetof(struct lp_options, source), .parse = parse_camera,
	 .expects = "a URI, at most four of them",
	 .help = "URI of the camera: see below, and --help-backends. Repeat it for several "
		 "cameras\n"
		 "in one box"},
	{"publish", LP_PARAM_OWN, offsetof(struct lp_options, publish), .parse = parse_publish,
	 .expects = "a URI, at most eight of them",
	 .help = "URI of a publisher; repeat it for more. Default: tcp:127.0.0.1:7700 and a\n"
		 "Unix socket in $XDG_RUNTIME_DIR or /run/lightprobe; with --once: stdout:"},
	{"camera", LP_PARAM_OWN, offsetof(struct lp_options, camera), .parse = parse_camera,
	 .expects = "equirect or a file, at most four of them",
	 .help = "equirect (default), or a camera file (lenses, masks, rotation); of several\n"
		 "cameras one for each --source, in the same order"},
	{"preset", LP_PARAM_CHOICE, offsetof(struct lp_options, preset), .initial = "balanced",
	 .choices = presets, .help = "trade-off between speed and accuracy"},
	{"panorama-width", LP_PARAM_OWN, offsetof(struct lp_options, panorama_width_px),
	 .initial = "0", .parse = parse_width, .expects = "0, or a multiple of 8 in 16..960",
	 .help = "columns of the panorama; 0: the width of the preset"},
	{"decode", LP_PARAM_OWN, offsetof(struct lp_options, decode_divisor), .initial = "0",
	 .parse = parse_decode, .expects = "0|blocks|pixels|2|4|8",
	 .help = "how frames are read: blocks (mean and detail of JPEG blocks, no pixels), pixels\n"
		 "(all), or 2, 4, 8 (JPEG at 1/N of its size); 0: what the preset says"},
	{"exact-blocks", LP_PARAM_OWN, offsetof(struct lp_options, exact_blocks),
	 .initial = "preset", .parse = parse_exact_blocks,
	 .expects = "preset, or a whole number 0..65536",
	 .help = "with --decode=blocks: how many blocks may still be decoded to pixels, beginning\n"
		 "with those whose mean says least about their light"},
	{"refine-cells", LP_PARAM_OWN, offsetof(struct lp_options, refine_cells),
	 .initial = "preset", .parse = parse_refine_cells,
	 .expects = "preset, or a whole number 0..1024",
	 .help = "largest lamp that is measured again in full resolution: the number of camera\n"
		 "cells with its light; 0: none"},
	{"latency-goal-ms", LP_PARAM_FLOAT, offsetof(struct lp_options, goals.latency_ms),
	 .initial = "0", .max = 60000,
	 .help = "lower the preset while more than one estimate in ten takes longer; 0: never"},
	{"cpu-budget-percent", LP_PARAM_FLOAT, offsetof(struct lp_options, goals.cpu_percent),
	 .initial = "0", .max = 6400,
	 .help = "lower the preset while more of a core is used; 0: never"},
	{"detector", LP_PARAM_OWN, offsetof(struct lp_options, detector), .initial = "adaptive",
	 .parse = parse_detector, .expects = "adaptive|research[:RADIANCE]",
	 .help = "how lamps are found; research: as published, to compare, at this radiance or\n"
		 "at the median"},
	{"sh-order", LP_PARAM_INT, offsetof(struct lp_options, sh_order), .initial = "4",
	 .max = LP_MAX_SH_ORDER, .help = "highest order of spherical harmonics offered"},
	{"lights", LP_PARAM_INT, offsetof(struct lp_options, lights), .initial = "8",
	 .max = LP_MAX_LIGHTS, .help = "maximum number of lights to find"},
	{"reflection-map", LP_PARAM_OWN, offsetof(struct lp_options, reflection_size),
	 .initial = "off", .parse = parse_reflection_size, .expects = "off|16|32|64",
	 .help = "let clients ask for reflection maps of up to so many texels along an edge: a\n"
		 "picture of the room, which whoever may connect can then see"},
	{"orientation", LP_PARAM_OWN, offsetof(struct lp_options, orientation), .initial = "visual",
	 .parse = parse_orientation, .expects = "visual|none|client|frames|URI of a sensor",
	 .help = "how it is known where the camera looks. visual: by its own frames; none: it\n"
		 "never turns; client: an app sends its head poses besides; frames: pictures of\n"
		 "sim:, or of file: with poses, carry it besides; iio:NAME: a gyroscope.\n"
		 "With --once pictures are of one place: none"},
	{"mount", LP_PARAM_TEXT, offsetof(struct lp_options, mount), .initial = "", .max = 1024,
	 .help = "file with the rotation from the probe to the head whose poses a client sends,\n"
		 "or to the sensor;\n"
		 "default: both look the same way"},
	{"smoothing-ms", LP_PARAM_FLOAT, offsetof(struct lp_options, smoothing_ms),
	 .initial = "200", .max = 60000, .help = "time constant of the smoothed estimate; 0: none"},
	{"ttl-ms", LP_PARAM_FLOAT, offsetof(struct lp_options, ttl_ms), .initial = "1000",
	 .min = 10, .max = 3600000,
	 .help = "after this time without a frame the last estimate is repeated, marked STALE"},
	{"brackets", LP_PARAM_INT, offsetof(struct lp_options, brackets), .initial = "3",
	 .max = LP_MAX_PLANNED,
	 .help = "maximum number of exposures in a bracket; the scene decides how many are used.\n"
		 "For cameras whose exposure can be set. 0: leave the exposure alone"},
	{"exposure-us", LP_PARAM_FLOAT, offsetof(struct lp_options, exposure_us), .initial = "0",
	 .max = 1e8,
	 .help = "one fixed exposure instead of brackets, if it can be set; 0: brackets"},
	{"gain", LP_PARAM_FLOAT, offsetof(struct lp_options, gain), .initial = "0", .max = 1e4,
	 .help = "set the camera's gain (linear factor), with --exposure-us; 0: leave it"},
	{"rotator", LP_PARAM_TEXT, offsetof(struct lp_options, rotator), .initial = "",
	 .max = LP_URI_MAX_BYTES,
	 .help = "URI of the polarizer wheel (lightprobed --help-backends); default: no wheel"},
	{"wheel-angles", LP_PARAM_FLOATS, offsetof(struct lp_options, wheel_angles_deg),
	 .initial = "0", .max = 180,
	 .help = "angles of the wheel in degrees: one to stay at, or several to visit in turn"},
	{"polarizer", LP_PARAM_OWN, offsetof(struct lp_options, polarizer), .initial = "off",
	 .parse = parse_polarizer, .expects = "off|sweep|fixed:DEGREES|films",
	 .help = "the wheel carries a polarizing film: measure how light is polarized and tell\n"
		 "reflections from lamps (sweep: at the wheel's angles, to and fro, by default 0,\n"
		 "45, 90, 135 and 180; fixed: only divide by what the film lets through); films: "
		 "three films at\n"
		 "90, 45 and 0 degrees stand before the lens, without a wheel; off: light is\n"
		 "what passes the film"},
	{"polarizer-transmission", LP_PARAM_FLOAT,
	 offsetof(struct lp_options, polarizer_transmission), .initial = "0", .max = 1,
	 .help = "of the film: of light along its axis plus of light across it; 0: as the camera\n"
		 "file says (lightprobe calibrate polarizer writes it), or 0.84"},
	{"polarizer-extinction", LP_PARAM_FLOAT, offsetof(struct lp_options, polarizer_extinction),
	 .initial = "0", .max = 1e9,
	 .help = "extinction ratio of the film; 0: as the camera file says, or 500"},
	{"polarizer-offset", LP_PARAM_FLOAT, offsetof(struct lp_options, polarizer_offset_deg),
	 .initial = "0", .min = -180, .max = 180,
	 .help = "degrees from the wheel's angle to the film's axis; 0: as the camera file says"},
	{"polarizer-index", LP_PARAM_OWN, offsetof(struct lp_options, polarizer_index),
	 .initial = "0", .parse = parse_index, .expects = "0, 1..2",
	 .help = "refractive index of the film's surfaces, which take light off the axis, 1: "
		 "none;\n"
		 "0: as the camera file says, or 1.5"},
	{"polarizer-rest", LP_PARAM_FLOAT, offsetof(struct lp_options, polarizer_rest_s),
	 .initial = "0", .max = 86400,
	 .help = "seconds that the wheel rests after each sweep, unless a new lamp appears; 0: it\n"
		 "sweeps on and on"},
	{"publish-polarization", LP_PARAM_BOOL, offsetof(struct lp_options, publish_polarization),
	 .initial = "0",
	 .help = "let clients ask for pictures of how light is polarized, with cells of 3 degrees\n"
		 "(lightprobe polarization); without it no picture leaves the probe"},
	{"wheel-dwell-ms", LP_PARAM_FLOAT, offsetof(struct lp_options, wheel_dwell_ms),
	 .initial = "500", .max = 3600000,
	 .help = "how long the wheel stays at each of several angles; with --polarizer=sweep at\n"
		 "most: it goes on when each exposure of the bracket has been there"},
	{"ring", LP_PARAM_TEXT, offsetof(struct lp_options, ring), .initial = "",
	 .max = LP_URI_MAX_BYTES,
	 .help = "URI of the ring of light sensors (lightprobed --help-backends); default: no "
		 "ring"},
	{"cd-m2-per-unit", LP_PARAM_FLOAT, offsetof(struct lp_options, cd_m2_per_unit),
	 .initial = "0", .max = 1e12,
	 .help = "luminance of radiance 1; 0: what the camera file says (lightprobe calibrate\n"
		 "scale)"},
	{"cd-m2-per-unit-sigma", LP_PARAM_FLOAT, offsetof(struct lp_options, cd_m2_per_unit_sigma),
	 .initial = "0.05", .min = 0.001, .max = 10, .help = "relative 1 sigma of it"},
	{"max-clients", LP_PARAM_INT, offsetof(struct lp_options, max_clients), .initial = "256",
	 .min = 1, .max = 4096, .help = "maximum number of connected clients; more are refused"},
	{"name", LP_PARAM_TEXT, offsetof(struct lp_options, name), .initial = "", .max = 64,
	 .help = "name of this probe for its clients; default: the host's name"},
	{"insecure-lan", LP_PARAM_BOOL, offsetof(struct lp_options, insecure_lan), .initial = "0",
	 .help = "let tcp: and ws: be opened beyond this machine, unencrypted and for anyone;\n"
		 "clients are told. The way without it is wss: with lightprobe pair"},
	{"log-level", LP_PARAM_CHOICE, offsetof(struct lp_options, log_level), .initial = "info",
	 .choices = log_levels, .help = "print messages of this level and of the more severe ones"},
};
/* Those that make sense in a configuration file. */
static const struct lp_params config_params = LP_PARAMS(config_list);

static const struct lp_param command_list[] = {
	{"config", LP_PARAM_TEXT, offsetof(struct lp_options, config), .initial = "", .max = 1024,
	 .help = "read options from this file: NAME = VALUE lines, # comments"},
	{"once", LP_PARAM_BOOL, offsetof(struct lp_options, once), .initial = "0",
	 .help = "process the frames of a finite source as one bracket, publish one estimate, "
		 "exit:\n"
		 "lightprobe estimate does so. Its options: --help-once"},
	{"simulated-time", LP_PARAM_TEXT, offsetof(struct lp_options, simulated_time),
	 .initial = "", .max = 108,
	 .help = "for tests: take the time from this Unix socket instead of the clock"},
	{"series", LP_PARAM_TEXT, offsetof(struct lp_options, series), .initial = "", .max = 1024,
	 .help = "for calibration: write the camera's raw frames into this new folder and exit,\n"
		 "without an estimate. No other option lets pictures leave the box"},
	{"series-us", LP_PARAM_FLOATS, offsetof(struct lp_options, series_us), .min = 0.001,
	 .max = 1e8,
	 .help = "with --series: exposures to command one after the other; none: no commands"},
	{"series-frames", LP_PARAM_INT, offsetof(struct lp_options, series_frames), .initial = "12",
	 .max = 10000, .help = "frames to write after each command; 0: until the source ends"},
	{"check-config", LP_PARAM_BOOL, offsetof(struct lp_options, check_config), .initial = "0",
	 .help = "check options and files, say what is wrong, and exit"},
	{"version", LP_PARAM_BOOL, offsetof(struct lp_options, version), .initial = "0",
	 .help = "print version and build options, and exit"},
	{"help", LP_PARAM_BOOL, offsetof(struct lp_options, help), .initial = "0",
	 .help = "print this help, and exit"},
	{"help-once", LP_PARAM_BOOL, offsetof(struct lp_options, help_once), .initial = "0",
	 .help = "print the options that serve --once only, and exit"},
	{"help-backends", LP_PARAM_BOOL, offsetof(struct lp_options, help_backends), .initial = "0",
	 .help = "print the keys of the URIs of cameras, wheels, rings and publishers, and exit"},
};
static const struct lp_params command_params = LP_PARAMS(command_list);
static const struct lp_params command_and_once = {command_list, LP_COUNT(command_list),
						  &lp_once_params};
static const struct lp_params params = {config_list, LP_COUNT(config_list), &command_and_once};

void lp_options_defaults(struct lp_options *options)
{
	memset(options, 0, sizeof(*options));
	lp_param_defaults(&params, options);
}

/* ---------------------------------------------------------------- configuration file */

/* Takes over what `ini` holds. The file has no sections. */
static int apply_config(struct lp_options *options, struct lp_ini *ini)
{
	static const char *const sections[] = {"", NULL};
	int ret = lp_ini_check_sections(ini, sections);

	if (ret == 0)
		ret = lp_ini_set(ini, "", &config_params, options);
	lp_ini_finish(ini);
	return ret;
}

int lp_options_read_config(struct lp_options *options, const char *name, const char *text,
			   size_t size_bytes)
{
	struct lp_ini ini;
	const int ret = lp_ini_parse(&ini, name, text, size_bytes);

	return ret < 0 ? ret : apply_config(options, &ini);
}

static int read_config_file(struct lp_options *options, const char *path)
{
	struct lp_ini ini;
	const int ret = lp_ini_read(&ini, path, "check --config");

	return ret < 0 ? ret : apply_config(options, &ini);
}

/* ---------------------------------------------------------------- command line */

struct argument {
	char name[32];
	const char *value;
};

/*
 * The argument at argv[*at]: --name=value, --name value, or --name of a yes/no option. Steps over
 * it. Unknown names pass: lp_param_set() knows better what to say.
 */
static int next_argument(int argc, char **argv, int *at, struct argument *argument)
{
	const char *text = argv[(*at)++];
	const char *equals = strchr(text, '=');
	const size_t length = equals ? (size_t)(equals - text) : strlen(text);
	const struct lp_param *param;

	if (length < 3 || strncmp(text, "--", 2) != 0 || length - 2 >= sizeof(argument->name)) {
		lp_error("lightprobed", text, "unknown option — see lightprobed --help");
		return -EINVAL;
	}
	(void)snprintf(argument->name, sizeof(argument->name), "%.*s", (int)length - 2, text + 2);
	argument->value = equals ? equals + 1 : "";
	param = lp_param_find(&params, argument->name);
	if (equals || !param)
		return 0;
	if (param->type == LP_PARAM_BOOL) {
		argument->value = "1";
	} else if (*at < argc) {
		argument->value = argv[(*at)++];
	} else {
		lp_error("lightprobed", text, "needs a value — see lightprobed --help");
		return -EINVAL;
	}
	return 0;
}

/* What serves pictures only would be without effect. */
static int check_once(const struct lp_options *options, int argc, char **argv)
{
	struct argument argument;

	for (int at = 1; at < argc && !options->once;) {
		char option[LP_COUNT(argument.name) + 2];

		(void)next_argument(argc, argv, &at, &argument);
		if (!lp_param_find(&lp_once_params, argument.name))
			continue;
		(void)snprintf(option, sizeof(option), "--%s", argument.name);
		lp_error("lightprobed", option,
			 "belongs to pictures that are read with --once, as lightprobe estimate "
			 "does — see --help-once");
		return -EINVAL;
	}
	return 0;
}

/* Apply the arguments named `only`, or all of them (NULL). */
static int read_arguments(struct lp_options *options, int argc, char **argv, const char *only)
{
	struct argument argument;
	int ret = 0;

	for (int at = 1; at < argc && ret == 0;) {
		ret = next_argument(argc, argv, &at, &argument);
		if (ret == 0 && (!only || strcmp(argument.name, only) == 0))
			ret = lp_param_set(&params, options, "lightprobed", argument.name,
					   argument.value);
	}
	return ret;
}

static void add_default_publishers(struct lp_options *options)
{
	const char *runtime = getenv("XDG_RUNTIME_DIR");
	char unix_socket[LP_URI_MAX_BYTES];

	if (options->once) {
		(void)parse_publish("stdout:", &options->publish);
		return;
	}
	(void)parse_publish("tcp:127.0.0.1:7700", &options->publish);
	(void)snprintf(unix_socket, sizeof(unix_socket), "unix:%s/lightprobe.sock",
		       runtime && *runtime ? runtime : "/run/lightprobe");
	(void)parse_publish(unix_socket, &options->publish);
}

int lp_options_read(struct lp_options *options, int argc, char **argv)
{
	int ret;

	lp_options_defaults(options);
	ret = read_arguments(options, argc, argv, "config");
	if (ret == 0 && *options->config)
		ret = read_config_file(options, options->config);
	if (ret == 0) {
		/* Lists on the command line replace those of the file. */
		int *const counts[] = {&options->publish.count, &options->source.count,
				       &options->camera.count};
		int from_file[LP_COUNT(counts)];

		for (size_t k = 0; k < LP_COUNT(counts); k++) {
			from_file[k] = *counts[k];
			*counts[k] = 0;
		}
		ret = read_arguments(options, argc, argv, NULL);
		for (size_t k = 0; k < LP_COUNT(counts); k++)
			if (*counts[k] == 0)
				*counts[k] = from_file[k];
	}
	if (ret == 0)
		ret = check_once(options, argc, argv);
	if (ret == 0 && options->publish.count == 0)
		add_default_publishers(options);
	return ret;
}

/* ---------------------------------------------------------------- for others */

void lp_options_help(FILE *out)
{
	(void)fputs("Options, with their defaults; also for the configuration file, as NAME = "
		    "VALUE:\n",
		    out);
	lp_param_print(out, "  --", &config_params);
	(void)fputs("\nOnly on the command line (a name alone means 1):\n", out);
	lp_param_print(out, "  --", &command_params);
}

void lp_options_help_once(FILE *out)
{
	(void)fputs("Options of --once, on the command line (a name alone means 1):\n", out);
	lp_param_print(out, "  --", &lp_once_params);
}

const char *lp_options_camera(const struct lp_options *options, int source)
{
	return source < options->camera.count ? options->camera.texts[source] : "equirect";
}

struct lp_pipeline_options lp_options_pipeline(const struct lp_options *options)
{
	return (struct lp_pipeline_options){
		.preset = (enum lp_preset)options->preset,
		.panorama_width = options->panorama_width_px,
		.decode_divisor = options->decode_divisor,
		.exact_blocks = options->exact_blocks,
		.refine_cells = options->refine_cells,
		.detector = options->detector,
		.max_lights = options->lights,
		.sh_order = options->sh_order,
		.brackets = options->brackets,
		.orientation = options->once ? LP_ORIENTATION_NONE : options->orientation.kind,
		.scale = options->cd_m2_per_unit > 0
				 ? (struct lp_ring_scale){options->cd_m2_per_unit,
							  options->cd_m2_per_unit_sigma}
				 : (struct lp_ring_scale){NAN, NAN},
		.smoothing_ms = options->smoothing_ms,
		.ttl_ms = options->ttl_ms,
		.reflection_size = options->reflection_size,
	};
}
