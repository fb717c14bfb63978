/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Exposure, gain, white balance and power-line filter of a camera are held still while we measure,
 * its processing is off; all is put back as it was afterwards. All calls on the capture thread;
 * they take as long as the camera does.
 */
#ifndef LP_SOURCE_V4L2_CONTROLS_H
#define LP_SOURCE_V4L2_CONTROLS_H

#include <stdbool.h>
#include <stdint.h>

#include "drivers/source/processing.h"
#include "drivers/source/v4l2/settings.h"

/* A control's range, as the driver tells it. Exposure is in 100 us. */
struct lp_v4l2_range {
	int64_t minimum, maximum, step;
};

/* Nearest value that the control can have. NAN: its minimum. */
int64_t lp_v4l2_to_control(double value, const struct lp_v4l2_range *range);

#define LP_V4L2_CONTROLS 24

struct lp_v4l2_controls {
	char object[96]; /* names the camera in messages */
	int fd;
	int gone; /* 0; or why the camera has gone or does not answer: it is asked nothing more */
	struct {
		bool held; /* `before` is to be put back */
		int64_t before;
	} list[LP_V4L2_CONTROLS];
	bool tells_processing; /* `processing` says what there is; false: nothing was looked at */
	struct lp_processing_report processing;
	bool exposure_settable;
	struct lp_v4l2_range exposure, gain;
	bool gain_settable;
	float gain_unity;  /* control value of linear gain 1; 0: the steps' meaning is not known */
	float exposure_us; /* in force, as read back; NAN: unknown */
	float linear_gain; /* in force; NAN: unknown */
};

/*
 * Save what is to be changed, and hold everything still. `fd` stays the caller's, and open for as
 * long as `controls` is used. What the camera cannot do is logged with what that costs; it is no
 * error. -ENODEV, -ETIMEDOUT, ...: the camera has gone, or does not answer.
 */
int lp_v4l2_controls_hold(struct lp_v4l2_controls *controls, int fd, const char *object,
			  const struct lp_v4l2_settings *settings);

/* Nearest exposure and gain that there are; what is in force is read back into `controls`. Logged.
 */
int lp_v4l2_controls_set_exposure(struct lp_v4l2_controls *controls, float exposure_us, float gain);

/* Put everything back; what cannot be put back is logged. Does nothing the second time. Each call
 * to a camera that hangs takes seconds: it ends with the first that is not answered. */
void lp_v4l2_controls_restore(struct lp_v4l2_controls *controls);

#endif
