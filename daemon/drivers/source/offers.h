/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera offers - formats, sizes, rates - what is wished for, and the choice among it. */
#ifndef LP_SOURCE_OFFERS_H
#define LP_SOURCE_OFFERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/param.h"
#include "include/frame.h"

#define LP_MAX_OFFERS 128
#define LP_MAX_RATES 16

/* Names as V4L2 writes them; libcamera's are the same but for grey. */
#define LP_FOURCC(a, b, c, d) \
	((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)
#define LP_FOURCC_MJPEG LP_FOURCC('M', 'J', 'P', 'G')
#define LP_FOURCC_JPEG LP_FOURCC('J', 'P', 'E', 'G')
#define LP_FOURCC_YUYV LP_FOURCC('Y', 'U', 'Y', 'V')
#define LP_FOURCC_NV12 LP_FOURCC('N', 'V', '1', '2')
#define LP_FOURCC_GREY LP_FOURCC('G', 'R', 'E', 'Y')

/* One format in one size. A driver that offers a range of sizes has its largest here, and says so.
 */
struct lp_offer {
	uint32_t fourcc;
	uint32_t width_px, height_px;
	uint32_t least_width_px, least_height_px; /* 0: the size is fixed */
	uint32_t step_width_px, step_height_px;
	int rate_count;	      /* 0: the driver does not say */
	bool rates_are_range; /* any rate between the two that are listed */
	float rates_hz[LP_MAX_RATES];
};

struct lp_offers {
	int count;
	struct lp_offer list[LP_MAX_OFFERS];
};

struct lp_offer_wish {
	int format;		/* enum lp_pixel_format; 0: choose */
	struct lp_size size_px; /* 0x0: choose */
	float fps;		/* 0: choose */
};

struct lp_offer_choice {
	uint32_t fourcc;
	enum lp_pixel_format format;
	uint32_t width_px, height_px;
	float rate_hz; /* 0: leave it to the driver */
};

/* The words for lp_offer_wish.format, by its value; ends with NULL. */
extern const char *const lp_offer_formats[];

/* Bytes of one row of the first plane, packed; 0 for MJPEG. And of the whole picture. */
uint32_t lp_row_bytes(enum lp_pixel_format format, uint32_t width_px);
size_t lp_picture_bytes(enum lp_pixel_format format, uint32_t stride_bytes, uint32_t height_px);

/*
 * What is asked for, exactly (listed rates within 1 %). What is left open: the largest picture up
 * to 1920x1080, of formats MJPEG (cheapest to read) before YUYV, NV12, GREY, at the highest rate up
 * to 30 Hz. -EINVAL: not offered.
 */
int lp_offers_choose(const struct lp_offers *offers, const struct lp_offer_wish *wish,
		     struct lp_offer_choice *choice);

/* "MJPEG 1920x960 at 25 is not offered — there is MJPG 1920x960 at 30/15/5, ..." into `text`, cut
 * short by "..." when it does not fit. Only of the format that is asked for, if there is one: the
 * text must be short enough for a fault on the wire (160 bytes). */
void lp_offers_refuse(const struct lp_offers *offers, const struct lp_offer_wish *wish, char *text,
		      size_t size_bytes);

/* The list alone. */
void lp_offers_describe(const struct lp_offers *offers, char *text, size_t size_bytes);

#endif
