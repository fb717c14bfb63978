/* SPDX-License-Identifier: Apache-2.0 */
/* One picture as the camera delivered it: compressed or raw, never yet interpreted. */
#ifndef LP_FRAME_H
#define LP_FRAME_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "include/crop.h"

enum lp_pixel_format {
	LP_FORMAT_MJPEG = 1, /* one JPEG image; also without DHT, as many UVC cameras send it */
	LP_FORMAT_YUYV,	     /* 4:2:2 packed, BT.601 full range as UVC cameras deliver */
	LP_FORMAT_NV12,	     /* 4:2:0, luma plane then interleaved CbCr */
	LP_FORMAT_GREY,	     /* 8-bit luma */
	LP_FORMAT_RGB_F32,   /* 3 x float32 scene-linear radiance, row 0 up; exposure is not applied
			      */
};

enum lp_frame_flag {
	LP_FRAME_CORRUPT = 1 << 0, /* the driver says so: count it, do not use it */
	LP_FRAME_LAST = 1 << 1,	   /* the source ends with this frame */
	/* Seldom, and seconds late: no newer frame takes its place, and what was seen since then
	 * counts more. */
	LP_FRAME_STILL = 1 << 2,
};

#define LP_MAX_CAMERAS 4

/* So many frames the consumer may hold at once: the pipeline the one it works on, a series those
 * that are not written yet. A source has some more to fill. */
#define LP_FRAMES_HELD 9

/* How well somebody knows a polarizer angle that they state (wheel_sigma_deg). */
#define LP_STATED_ANGLE_SIGMA_DEG 0.5F

/*
 * Borrowed from the source's pool: whoever holds it calls lp_frame_release() once, from any thread.
 * The source must outlive its frames. Everything but `data` may be read from any thread.
 */
struct lp_frame {
	enum lp_pixel_format format;
	uint32_t width_px, height_px;
	uint32_t stride_bytes; /* of a row of the first plane; 0 for MJPEG */
	const uint8_t *data;
	size_t size_bytes;
	uint64_t sequence; /* the source's own count; gaps are frames lost before us */
	/* CLOCK_MONOTONIC when the first row had been exposed, and the sensor began to read it:
	 * what cameras stamp, whatever the exposure was. */
	int64_t t_read_ns;
	float stamp_sigma_us;	 /* 1 sigma of that, where the camera's clock is not believed */
	const char *clock_fault; /* static: why it is not; NULL: it is */
	int64_t t_arrival_ns;	 /* CLOCK_MONOTONIC when the whole frame was in memory */
	float exposure_us;	 /* NAN: unknown */
	float gain;		 /* linear factor, 1 = base sensitivity; NAN: unknown */
	float wheel_deg;       /* polarizer angle during the exposure; NAN: no wheel, or unknown */
	float wheel_sigma_deg; /* 1 sigma; NAN: unknown */
	/* What the source itself knows of its orientation: x y z w, turns the probe's frame into
	 * one that does not move; all NAN: unknown. */
	float orientation[4];
	float orientation_sigma_deg; /* 1 sigma; NAN: unknown */
	int64_t t_orientation_ns;    /* that it is of; 0: of the middle, whenever that was */
	/* Where it was then, in that frame; 1 sigma along each axis, 0: unknown. */
	double position_m[3];
	float position_sigma_m;
	/* Who has told it, as a number: another one has another frame that does not move. */
	uint32_t orientation_by;
	float row_time_us;   /* the exposure of each row begins so much later than that of the row
			      * above; 0: all at once; NAN: unknown */
	float period_us;     /* from one frame of this camera to the next; the application sets it;
			      * NAN: not known yet */
	float brightest;     /* RGB_F32: the largest finite sample; 0: not known */
	struct lp_crop crop; /* that the picture states of itself, if it is equirectangular */
	uint32_t flags;	     /* enum lp_frame_flag */
	uint8_t camera;	     /* which of several, from 0; the application sets it */
	void (*release)(struct lp_frame *frame);
};

/* Exposure times gain; NAN: unknown. An unknown gain counts as 1. */
static inline float lp_frame_exposure_us(const struct lp_frame *frame)
{
	return frame->exposure_us * (isnan(frame->gain) ? 1.0F : frame->gain);
}

/* The longest exposure of cameras that are not told another: what keeps 30 frames a second. */
#define LP_LONGEST_EXPOSURE_US 33000.0F

/* When the exposure of the first row began, or may have begun at the earliest. */
static inline int64_t lp_frame_start_ns(const struct lp_frame *frame)
{
	const float unsure_us = 2.0F * frame->stamp_sigma_us;
	const float longest_us = fminf(frame->period_us, LP_LONGEST_EXPOSURE_US); /* not NAN */
	const float exposure_us = isnan(frame->exposure_us) ? longest_us : frame->exposure_us;

	return frame->t_read_ns - (int64_t)(1e3 * ((double)exposure_us + (double)unsure_us));
}

static inline void lp_frame_release(struct lp_frame *frame)
{
	if (frame)
		frame->release(frame);
}

#endif
