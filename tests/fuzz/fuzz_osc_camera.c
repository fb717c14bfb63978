/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a camera on the network may answer to the commands that open it and put it back: its info,
 * its options, its errors. Only HTTP is left out (drivers/source/osc/http.c), and time is the
 * input's. Input: answers with a line end between them, each for the next command; a camera that
 * has answered them all is not to be reached any more.
 */
#include "fuzz.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "drivers/source/osc/camera.h"

static struct {
	const uint8_t *at;
	size_t left;
	char *text; /* of the newest answer, exactly as long as it is */
	int64_t now_ns;
} answers;

/* The status is 401 for an answer that begins with '!', else 200. */
int lp_osc_http_request(struct lp_osc_http *http, const char *path, const char *body,
			struct lp_osc_reply *reply)
{
	const uint8_t *end = answers.left ? memchr(answers.at, '\n', answers.left) : NULL;
	const size_t bytes = end ? (size_t)(end - answers.at) : answers.left;

	(void)http;
	fuzz_assert(*path == '/' && (!body || *body == '{'));
	if (answers.left == 0)
		return -ETIMEDOUT;
	free(answers.text);
	answers.text = malloc(bytes + 1);
	fuzz_assert(answers.text != NULL);
	memcpy(answers.text, answers.at, bytes);
	answers.text[bytes] = '\0';
	answers.at += bytes + (end != NULL);
	answers.left -= bytes + (end != NULL);
	*reply = (struct lp_osc_reply){answers.text[0] == '!' ? 401 : 200, answers.text, bytes};
	return 0;
}

int lp_osc_http_end(struct lp_osc_http *http, struct lp_osc_reply *reply)
{
	(void)http;
	(void)reply;
	return -EAGAIN;
}

void lp_osc_http_turn(struct lp_osc_http *http, int wait_ms)
{
	(void)http;
	fuzz_assert(wait_ms > 0);
	answers.now_ns += wait_ms * LP_NS_PER_MS;
	lp_clock_simulate(answers.now_ns);
}

void lp_osc_http_stream_close(struct lp_osc_http *http)
{
	(void)http;
}

void lp_osc_http_last_words(struct lp_osc_http *http, int64_t left_ns)
{
	(void)http;
	fuzz_assert(left_ns > 0);
}

static void try_exposures(const struct lp_osc_camera *camera)
{
	static const float wanted_us[] = {0.0F, 1e-30F, 100.0F, 8000.0F, INFINITY};

	for (size_t i = 0; i < sizeof(wanted_us) / sizeof(*wanted_us); i++) {
		float exposure_us = wanted_us[i], gain = 1;

		lp_osc_exposures_snap(&camera->range, &exposure_us, &gain);
		fuzz_assert(exposure_us >= 0 && gain > 0);
		free(lp_osc_camera_exposure_body(camera, exposure_us, gain));
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const struct lp_osc_settings settings = {.host = "fuzz",
							.port = 80,
							.exposure_settable = 1,
							.exposure_delay_frames = -1,
							.white_balance_k = 6500};
	struct lp_osc_camera camera;
	struct lp_osc_fault fault;

	lp_log_set_level(LP_LOG_ERROR);
	answers.at = data;
	answers.left = size;
	answers.now_ns = LP_NS_PER_S;
	lp_clock_simulate(answers.now_ns);
	lp_osc_camera_init(&camera, &settings, NULL);
	for (int i = 0; i < 2; i++) { /* it goes, and comes back, perhaps as another one */
		if (lp_osc_camera_open(&camera, &fault) < 0)
			continue;
		fuzz_assert(camera.choice.width_px == 2 * camera.choice.height_px);
		if (camera.exposure_settable)
			try_exposures(&camera);
		(void)lp_osc_camera_show_capture(&camera, &fault);
	}
	lp_osc_camera_restore(&camera, LP_NS_PER_S);
	lp_osc_camera_finish(&camera);
	free(answers.text);
	answers.text = NULL;
	return 0;
}
