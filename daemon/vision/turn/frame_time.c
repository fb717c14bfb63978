/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/turn/frame_time.h"

#include <math.h>

#include "include/frame.h"

/* 1 sigma of a camera's time stamps, chosen by hand: what USB and the driver add to them. */
#define STAMP_SIGMA_S 0.002F
/* Standard deviation of what is anything between 0 and 1. */
#define UNIFORM_SIGMA 0.2887F

/* A duration of which only the longest is known. */
static float or_middle(float known_us, float longest_us, float *variance)
{
	if (!isnan(known_us))
		return known_us;
	/* half of it lies between the reading and the middle */
	*variance += powf(0.5e-6F * UNIFORM_SIGMA * longest_us, 2.0F);
	return 0.5F * longest_us;
}

struct lp_frame_time lp_frame_time(const struct lp_frame *frame, float exposure_us)
{
	const float longest_us = fminf(frame->period_us, LP_LONGEST_EXPOSURE_US); /* not NAN */
	const float rows_us = frame->row_time_us * (float)frame->height_px;
	float variance = STAMP_SIGMA_S * STAMP_SIGMA_S + powf(1e-6F * frame->stamp_sigma_us, 2.0F);
	const float exposed_us = or_middle(exposure_us, longest_us, &variance);
	const float read_us = or_middle(rows_us, longest_us, &variance);

	return (struct lp_frame_time){.middle_ns =
					      frame->t_read_ns +
					      (int64_t)(500.0 * ((double)read_us - exposed_us)),
				      .sigma_s = sqrtf(variance),
				      .read_out_s = isnan(rows_us) ? 0.0F : 1e-6F * rows_us};
}
