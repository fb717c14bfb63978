/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/offers.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#define DEFAULT_PIXELS ((uint64_t)1920 * 1080)
#define DEFAULT_RATE_HZ 30.0F
#define RATE_TOLERANCE 0.01F

/* In order of preference. */
static const struct {
	uint32_t fourcc;
	enum lp_pixel_format format;
} known_formats[] = {
	{LP_FOURCC_MJPEG, LP_FORMAT_MJPEG}, {LP_FOURCC_JPEG, LP_FORMAT_MJPEG},
	{LP_FOURCC_YUYV, LP_FORMAT_YUYV},   {LP_FOURCC_NV12, LP_FORMAT_NV12},
	{LP_FOURCC_GREY, LP_FORMAT_GREY},
};

const char *const lp_offer_formats[] = {"auto", "mjpeg", "yuyv", "nv12", "grey", NULL};

#define KNOWN_FORMATS ((int)LP_COUNT(known_formats))

/* Smaller is better; KNOWN_FORMATS: cannot be used. */
static int preference(uint32_t fourcc)
{
	int i = 0;

	while (i < KNOWN_FORMATS && known_formats[i].fourcc != fourcc)
		i++;
	return i;
}

/* 0: none that can be used. */
static enum lp_pixel_format format_of(uint32_t fourcc)
{
	const int i = preference(fourcc);

	return i < KNOWN_FORMATS ? known_formats[i].format : 0;
}

uint32_t lp_row_bytes(enum lp_pixel_format format, uint32_t width_px)
{
	return format == LP_FORMAT_MJPEG ? 0 : format == LP_FORMAT_YUYV ? width_px * 2 : width_px;
}

size_t lp_picture_bytes(enum lp_pixel_format format, uint32_t stride_bytes, uint32_t height_px)
{
	const size_t plane = (size_t)stride_bytes * height_px;

	return format == LP_FORMAT_NV12 ? plane + plane / 2 : plane;
}

/* ---------------------------------------------------------------- the choice */

static bool fits(uint32_t value, uint32_t least, uint32_t most, uint32_t step)
{
	return value == most || (least && value >= least && value < most &&
				 (step < 2 || (value - least) % step == 0));
}

/* Of a range: the wanted rate, or what is left open. -1: not offered. */
static float choose_rate_in_range(const struct lp_offer *offer, float wanted_hz)
{
	const float least = fminf(offer->rates_hz[0], offer->rates_hz[1]);
	const float most = fmaxf(offer->rates_hz[0], offer->rates_hz[1]);
	const float rate = wanted_hz > 0 ? wanted_hz : DEFAULT_RATE_HZ;
	const float nearest = fminf(fmaxf(rate, least), most);

	return wanted_hz > 0 && fabsf(nearest - wanted_hz) > RATE_TOLERANCE * wanted_hz ? -1
											: nearest;
}

/* The wanted rate, or the best where none is; -1: not offered. */
static float choose_rate(const struct lp_offer *offer, float wanted_hz)
{
	float best = -1;

	if (offer->rate_count == 0)
		return wanted_hz;
	if (offer->rates_are_range)
		return choose_rate_in_range(offer, wanted_hz);
	for (int i = 0; i < offer->rate_count; i++) {
		const float rate = offer->rates_hz[i];

		if (wanted_hz > 0 && fabsf(rate - wanted_hz) <= RATE_TOLERANCE * wanted_hz)
			return rate;
		/* The highest that is not too high; if all are, the lowest. */
		if (wanted_hz == 0 && (best < 0 || (rate <= DEFAULT_RATE_HZ * (1 + RATE_TOLERANCE)
							    ? rate > best || best > DEFAULT_RATE_HZ
							    : rate < best)))
			best = rate;
	}
	return best;
}

/* Does the offer, in the size that would be used, answer what is asked for? */
static bool consider(const struct lp_offer *offer, const struct lp_offer_wish *wish,
		     struct lp_offer_choice *choice)
{
	const struct lp_size *size = &wish->size_px;

	*choice = (struct lp_offer_choice){
		.fourcc = offer->fourcc,
		.format = format_of(offer->fourcc),
		.width_px = size->width ? size->width : offer->width_px,
		.height_px = size->height ? size->height : offer->height_px,
		.rate_hz = choose_rate(offer, wish->fps),
	};
	return choice->format && choice->rate_hz >= 0 &&
	       (wish->format == 0 || wish->format == (int)choice->format) &&
	       fits(choice->width_px, offer->least_width_px, offer->width_px,
		    offer->step_width_px) &&
	       fits(choice->height_px, offer->least_height_px, offer->height_px,
		    offer->step_height_px);
}

static uint64_t pixels(const struct lp_offer_choice *choice)
{
	return (uint64_t)choice->width_px * choice->height_px;
}

static bool is_better(const struct lp_offer_choice *a, const struct lp_offer_choice *b)
{
	const bool a_fits = pixels(a) <= DEFAULT_PIXELS, b_fits = pixels(b) <= DEFAULT_PIXELS;

	if (a_fits != b_fits)
		return a_fits;
	if (preference(a->fourcc) != preference(b->fourcc))
		return preference(a->fourcc) < preference(b->fourcc);
	return a_fits ? pixels(a) > pixels(b) : pixels(a) < pixels(b);
}

int lp_offers_choose(const struct lp_offers *offers, const struct lp_offer_wish *wish,
		     struct lp_offer_choice *choice)
{
	struct lp_offer_choice candidate;
	bool found = false;

	for (int i = 0; i < offers->count; i++) {
		if (!consider(&offers->list[i], wish, &candidate))
			continue;
		if (!found || is_better(&candidate, choice))
			*choice = candidate;
		found = true;
	}
	return found ? 0 : -EINVAL;
}

/* ---------------------------------------------------------------- in words */

static int describe_offer(const struct lp_offer *offer, bool same_format, char *text,
			  size_t size_bytes)
{
	const char *const fourcc = (const char *)&offer->fourcc;
	int used = same_format ? snprintf(text, size_bytes, ",")
			       : snprintf(text, size_bytes, "%.4s", fourcc);

	if (offer->least_width_px)
		used += snprintf(text + used, size_bytes - (size_t)used, " %ux%u to",
				 offer->least_width_px, offer->least_height_px);
	used += snprintf(text + used, size_bytes - (size_t)used, " %ux%u", offer->width_px,
			 offer->height_px);
	for (int i = 0; i < offer->rate_count && (size_t)used < size_bytes; i++)
		used += snprintf(text + used, size_bytes - (size_t)used, "%s%g",
				 i == 0			  ? " at "
				 : offer->rates_are_range ? " to "
							  : "/",
				 (double)offer->rates_hz[i]);
	return used;
}

void lp_offers_describe(const struct lp_offers *offers, char *text, size_t size_bytes)
{
	size_t used = 0;
	char part[256];

	snprintf(text, size_bytes, "nothing");
	for (int i = 0; i < offers->count; i++) {
		const struct lp_offer *offer = &offers->list[i];
		const bool same_format = i > 0 && offer[-1].fourcc == offer->fourcc;
		const size_t length =
			(size_t)describe_offer(offer, same_format, part, sizeof(part));

		if (used + length + sizeof("; ...") > size_bytes) {
			snprintf(text + used, size_bytes - used, " ...");
			return;
		}
		used += (size_t)snprintf(text + used, size_bytes - used, "%s%s",
					 i > 0 && !same_format ? "; " : "", part);
	}
}

/* What was asked for, in words. */
static void describe_wish(const struct lp_offer_wish *wish, char *text, size_t size_bytes)
{
	static const char *const names[] = {"any format", "MJPEG", "YUYV", "NV12", "GREY"};
	int used = snprintf(text, size_bytes, "%s", names[wish->format]);

	if (wish->size_px.width)
		used += snprintf(text + used, size_bytes - (size_t)used, " %ux%u",
				 wish->size_px.width, wish->size_px.height);
	if (wish->fps > 0)
		snprintf(text + used, size_bytes - (size_t)used, " at %g", (double)wish->fps);
}

void lp_offers_refuse(const struct lp_offers *offers, const struct lp_offer_wish *wish, char *text,
		      size_t size_bytes)
{
	char wished[64], offered[256];
	struct lp_offers alike = {0};

	for (int i = 0; i < offers->count; i++)
		if (wish->format && (int)format_of(offers->list[i].fourcc) == wish->format)
			alike.list[alike.count++] = offers->list[i];
	describe_wish(wish, wished, sizeof(wished));
	lp_offers_describe(alike.count ? &alike : offers, offered, sizeof(offered));
	snprintf(text, size_bytes, "%s is not offered — there is %s", wished, offered);
}
