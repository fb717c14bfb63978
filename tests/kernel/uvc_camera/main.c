/* SPDX-License-Identifier: Apache-2.0 */
/* A UVC camera in user space, for tests of what drives real ones. Needs raw_gadget and dummy_hcd.
 */
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "camera.h"
#include "commands.h"

static const char usage[] =
	"uvc_camera [OPTION...]: a USB camera on dummy_hcd, for tests\n"
	"  --pictures=URI        pattern: (default), folder:PATH or sim:PATH?QUERY (pictures.h)\n"
	"  --controller=NAME     where to plug in (dummy_udc.0)\n"
	"  --commands=PATH       control socket (/run/uvc_camera)\n"
	"  --usb=VENDOR:PRODUCT  identity, hexadecimal (1d6b:0102)\n"
	"  --name=TEXT           product (lightprobe test camera)\n"
	"  --serial=TEXT         serial number (0001); empty: none\n"
	"  --exposure=KIND       settable (default), read-only (backlight, too) or missing\n"
	"  --delay=N             frames from a control's change to its effect, 0..4 (0)\n"
	"  --unplugged           do not plug in before the command `plug`\n"
	"  --verbose             print every control request\n"
	"Commands on the socket:\n";

enum argument {
	PICTURES = 1,
	CONTROLLER,
	COMMANDS,
	USB,
	NAME,
	SERIAL,
	EXPOSURE,
	DELAY,
	UNPLUGGED,
	VERBOSE,
	HELP
};

static const struct option long_options[] = {
	{"pictures", required_argument, NULL, PICTURES},
	{"controller", required_argument, NULL, CONTROLLER},
	{"commands", required_argument, NULL, COMMANDS},
	{"usb", required_argument, NULL, USB},
	{"name", required_argument, NULL, NAME},
	{"serial", required_argument, NULL, SERIAL},
	{"exposure", required_argument, NULL, EXPOSURE},
	{"delay", required_argument, NULL, DELAY},
	{"unplugged", no_argument, NULL, UNPLUGGED},
	{"verbose", no_argument, NULL, VERBOSE},
	{"help", no_argument, NULL, HELP},
	{0},
};

static int parse_exposure(const char *text, enum camera_exposure *exposure)
{
	static const char *const kinds[] = {"settable", "read-only", "missing"};

	for (int i = 0; i < 3; i++) {
		if (strcmp(text, kinds[i]) == 0) {
			*exposure = i;
			return 0;
		}
	}
	return -1;
}

/* 0, 1: end with success, -1: wrong. */
static int parse(int argc, char **argv, struct camera_options *options, bool *unplugged)
{
	int option;

	while ((option = getopt_long(argc, argv, "", long_options, NULL)) != -1) {
		switch (option) {
		case PICTURES:
			options->pictures = optarg;
			break;
		case CONTROLLER:
			options->controller = optarg;
			break;
		case COMMANDS:
			options->commands = optarg;
			break;
		case USB:
			if (sscanf(optarg, "%hx:%hx", &options->vendor, &options->product) != 2)
				return -1;
			break;
		case NAME:
			options->name = optarg;
			break;
		case SERIAL:
			options->serial = optarg;
			break;
		case EXPOSURE:
			if (parse_exposure(optarg, &options->exposure) < 0)
				return -1;
			break;
		case DELAY:
			options->delay_frames = atoi(optarg);
			if (options->delay_frames < 0 || options->delay_frames > CAMERA_MAX_DELAY)
				return -1;
			break;
		case UNPLUGGED:
			*unplugged = true;
			break;
		case VERBOSE:
			options->verbose = true;
			break;
		case HELP:
			return 1;
		default:
			return -1;
		}
	}
	return optind == argc ? 0 : -1;
}

static void wake(int number)
{
	(void)number; /* calls of the thread that gets it end with EINTR: that is all */
}

static void handle_signals(void)
{
	const struct sigaction action = {.sa_handler = wake}; /* without SA_RESTART */

	sigaction(SIGUSR1, &action, NULL);
	signal(SIGPIPE, SIG_IGN);
}

int main(int argc, char **argv)
{
	struct camera_options options = {
		.vendor = 0x1d6b,
		.product = 0x0102,
		.name = "lightprobe test camera",
		.serial = "0001",
		.pictures = "pattern:",
		.commands = "/run/uvc_camera",
		.controller = "dummy_udc.0",
	};
	struct pictures *pictures;
	struct camera *camera;
	bool unplugged = false;
	int ret = parse(argc, argv, &options, &unplugged);

	if (ret) {
		fprintf(ret < 0 ? stderr : stdout, "%s%s", usage, commands_help);
		return ret < 0 ? 2 : 0;
	}
	handle_signals();
	pictures = pictures_create(options.pictures);
	if (!pictures)
		return 1;
	camera = camera_create(&options, pictures);
	ret = !camera ? -1 : unplugged ? 0 : camera_plug(camera, options.controller);
	if (ret < 0)
		fprintf(stderr, "uvc_camera: %s: cannot plug in: %s\n", options.controller,
			strerror(-ret));
	else
		ret = commands_serve(camera, &options);
	if (ret < 0)
		fprintf(stderr, "uvc_camera: %s: %s\n", options.commands, strerror(-ret));
	camera_destroy(camera);
	pictures_destroy(pictures);
	return ret < 0;
}
