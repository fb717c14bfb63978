/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/photo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---------------------------------------------------------------- Exif */

enum {
	TAG_ORIENTATION = 0x0112,
	TAG_EXIF_IFD = 0x8769,
	TAG_EXPOSURE_TIME = 0x829a,
	TAG_F_NUMBER = 0x829d,
	TAG_ISO = 0x8827,
};

struct tiff {
	const uint8_t *data;
	size_t size_bytes;
	bool is_big_endian;
};

/* Beyond the end: 0. */
static uint32_t number_at(const struct tiff *tiff, size_t at, size_t bytes)
{
	uint32_t value = 0;

	if (at > tiff->size_bytes || tiff->size_bytes - at < bytes)
		return 0;
	for (size_t i = 0; i < bytes; i++)
		value |= (uint32_t)tiff->data[at + i]
			 << 8 * (tiff->is_big_endian ? bytes - 1 - i : i);
	return value;
}

/* Place of the entry of a directory; 0: it has none. */
static size_t find_entry(const struct tiff *tiff, size_t directory, uint32_t tag)
{
	const uint32_t count = number_at(tiff, directory, 2);

	for (uint32_t i = 0; i < count; i++) {
		const size_t at = directory + 2 + 12 * (size_t)i;

		if (at + 12 > tiff->size_bytes)
			return 0;
		if (number_at(tiff, at, 2) == tag)
			return at;
	}
	return 0;
}

static int short_of(const struct tiff *tiff, size_t directory, uint32_t tag)
{
	const size_t entry = find_entry(tiff, directory, tag);

	return entry ? (int)number_at(tiff, entry + 8, 2) : 0;
}

/* A fraction above 0, or NAN. */
static float rational_of(const struct tiff *tiff, size_t directory, uint32_t tag)
{
	const size_t entry = find_entry(tiff, directory, tag);

	if (!entry)
		return NAN;
	const size_t at = number_at(tiff, entry + 8, 4);
	const double above = number_at(tiff, at, 4), below = number_at(tiff, at + 4, 4);

	return above > 0.0 && below > 0.0 ? (float)(above / below) : NAN;
}

static void read_exif(struct lp_photo *photo, const uint8_t *data, size_t size_bytes)
{
	const struct tiff tiff = {data, size_bytes, data[0] == 'M'};
	const size_t directory = number_at(&tiff, 4, 4);
	const size_t pointer = find_entry(&tiff, directory, TAG_EXIF_IFD);
	const int orientation = short_of(&tiff, directory, TAG_ORIENTATION);

	photo->orientation = orientation <= 8 ? orientation : 0;
	if (!pointer)
		return;
	const size_t exif = number_at(&tiff, pointer + 8, 4);

	photo->exposure_us = 1e6F * rational_of(&tiff, exif, TAG_EXPOSURE_TIME);
	photo->f_number = rational_of(&tiff, exif, TAG_F_NUMBER);
	photo->iso = short_of(&tiff, exif, TAG_ISO);
}

/* ---------------------------------------------------------------- GPano
 * https://developers.google.com/streetview/spherical-metadata */

#define XMP_MOST_BYTES 65536

/* The text behind NAME= or <NAME>, whatever the prefix of its namespace; NULL: it is not there. */
static const char *property(const char *xmp, const char *name)
{
	const char *at = strstr(xmp, name);

	if (!at)
		return NULL;
	at += strlen(name);
	return at + strspn(at, " \t\r\n=>\"'");
}

/* NAN: it is not there, or no number. */
static double number_of(const char *xmp, const char *name)
{
	const char *text = property(xmp, name);
	char *end = NULL;
	const double number = text ? strtod(text, &end) : NAN;

	return end != text ? number : NAN;
}

static void read_gpano(struct lp_photo *photo, const char *xmp)
{
	const char *projection = property(xmp, ":ProjectionType");
	const double full_width = number_of(xmp, ":FullPanoWidthPixels");
	const double full_height = number_of(xmp, ":FullPanoHeightPixels");

	if (projection && strncmp(projection, "equirectangular", 15) != 0) {
		photo->crop = LP_CROP_UNUSABLE;
		return;
	}
	if (isnan(full_width) && isnan(full_height))
		return;
	photo->crop = lp_crop_of(number_of(xmp, ":CroppedAreaLeftPixels"),
				 number_of(xmp, ":CroppedAreaTopPixels"),
				 number_of(xmp, ":CroppedAreaImageWidthPixels"),
				 number_of(xmp, ":CroppedAreaImageHeightPixels"), full_width,
				 full_height);
}

static void read_xmp(struct lp_photo *photo, const uint8_t *data, size_t size_bytes)
{
	char text[XMP_MOST_BYTES];

	memcpy(text, data, size_bytes);
	text[size_bytes] = '\0';
	if (strstr(text, "/photos/1.0/panorama/"))
		read_gpano(photo, text);
}

/* ---------------------------------------------------------------- JPEG */

/* The content of a segment that begins with a mark; NULL: it does not. */
static const uint8_t *behind(const uint8_t *content, size_t size_bytes, const char *mark,
			     size_t mark_bytes)
{
	return size_bytes > mark_bytes && memcmp(content, mark, mark_bytes) == 0
		       ? content + mark_bytes
		       : NULL;
}

struct lp_photo lp_photo_read(const uint8_t *jpeg, size_t size_bytes)
{
	static const char exif_mark[] = "Exif\0", xmp_mark[] = "http://ns.adobe.com/xap/1.0/";
	struct lp_photo photo = {.exposure_us = NAN, .f_number = NAN};
	size_t at = 2;

	while (at + 4 <= size_bytes && jpeg[at] == 0xff && jpeg[at + 1] != 0xda) {
		const size_t length = (size_t)jpeg[at + 2] << 8 | jpeg[at + 3];
		const uint8_t *content = jpeg + at + 4, *found;

		if (jpeg[at + 1] == 0xff) { /* fill byte */
			at++;
			continue;
		}
		if (length < 2 || size_bytes - at < 2 + length)
			break;
		if (jpeg[at + 1] == 0xe1) {
			found = behind(content, length - 2, exif_mark, sizeof(exif_mark));
			if (found)
				read_exif(&photo, found, length - 2 - sizeof(exif_mark));
			found = behind(content, length - 2, xmp_mark, sizeof(xmp_mark));
			if (found)
				read_xmp(&photo, found, length - 2 - sizeof(xmp_mark));
		}
		at += 2 + length;
	}
	return photo;
}
