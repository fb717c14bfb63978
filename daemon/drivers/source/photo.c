/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/photo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/macros.h"

/* ---------------------------------------------------------------- Exif */

enum {
	TAG_ORIENTATION = 0x0112,
	TAG_EXIF_IFD = 0x8769,
	TAG_EXPOSURE_TIME = 0x829a,
	TAG_F_NUMBER = 0x829d,
	TAG_ISO = 0x8827,
	TAG_STANDARD_SENSITIVITY = 0x8831,
	TAG_RECOMMENDED_EXPOSURE_INDEX = 0x8832,
	TAG_ISO_SPEED = 0x8833,
	TAG_SHUTTER_SPEED = 0x9201, /* APEX: these two are exponents of 2 */
	TAG_APERTURE = 0x9202,
};

enum { ISO_BEYOND_SHORT = 65535 }; /* "see the tags of 32 bits" */

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
static double rational_of(const struct tiff *tiff, size_t directory, uint32_t tag)
{
	const size_t entry = find_entry(tiff, directory, tag);

	if (!entry)
		return NAN;
	const size_t at = number_at(tiff, entry + 8, 4);
	const double above = number_at(tiff, at, 4), below = number_at(tiff, at + 4, 4);

	return above > 0.0 && below > 0.0 ? above / below : NAN;
}

/* A fraction of either sign, or NAN. */
static double signed_rational_of(const struct tiff *tiff, size_t directory, uint32_t tag)
{
	const size_t entry = find_entry(tiff, directory, tag);

	if (!entry)
		return NAN;
	const size_t at = number_at(tiff, entry + 8, 4);
	const int32_t above = (int32_t)number_at(tiff, at, 4);
	const int32_t below = (int32_t)number_at(tiff, at + 4, 4);

	return below ? (double)above / below : NAN;
}

static int iso_of(const struct tiff *tiff, size_t exif)
{
	static const uint32_t wide[] = {TAG_RECOMMENDED_EXPOSURE_INDEX, TAG_ISO_SPEED,
					TAG_STANDARD_SENSITIVITY};
	const int iso = short_of(tiff, exif, TAG_ISO);

	for (size_t i = 0; (iso == 0 || iso == ISO_BEYOND_SHORT) && i < LP_COUNT(wide); i++) {
		const size_t entry = find_entry(tiff, exif, wide[i]);
		const uint32_t speed = entry ? number_at(tiff, entry + 8, 4) : 0;

		if (speed > 0 && speed <= INT32_MAX)
			return (int)speed;
	}
	return iso;
}

/* Exposure time, aperture and speed complete each other, APEX values the direct ones: NAN and 0
 * stay where nothing says.
 */
static void complete(struct lp_photo *photo, double exposure_s, double shutter_speed_apex,
		     double f_number, double aperture_apex, int iso)
{
	if (!(exposure_s > 0.0))
		exposure_s = exp2(-shutter_speed_apex);
	if (!(f_number > 0.0))
		f_number = exp2(aperture_apex / 2.0);
	const float exposure_us = (float)(1e6 * exposure_s), f = (float)f_number;

	if (!isnan(photo->exposure_us) || !(exposure_us > 0.0F) || !isfinite(exposure_us))
		return;
	photo->exposure_us = exposure_us;
	photo->f_number = f > 0.0F && isfinite(f) ? f : NAN;
	photo->iso = iso;
}

static void read_exif(struct lp_photo *photo, const uint8_t *data, size_t size_bytes)
{
	const struct tiff tiff = {data, size_bytes, data[0] == 'M'};
	const size_t directory = number_at(&tiff, 4, 4);
	const size_t pointer = find_entry(&tiff, directory, TAG_EXIF_IFD);
	const int orientation = short_of(&tiff, directory, TAG_ORIENTATION);

	if (orientation >= 1 && orientation <= 8)
		photo->orientation = orientation;
	if (!pointer)
		return;
	const size_t exif = number_at(&tiff, pointer + 8, 4);

	struct lp_photo own = *photo;

	own.exposure_us = NAN; /* without what XMP said before */
	complete(&own, rational_of(&tiff, exif, TAG_EXPOSURE_TIME),
		 signed_rational_of(&tiff, exif, TAG_SHUTTER_SPEED),
		 rational_of(&tiff, exif, TAG_F_NUMBER),
		 signed_rational_of(&tiff, exif, TAG_APERTURE), iso_of(&tiff, exif));
	if (!isnan(own.exposure_us))
		*photo = own;
}

/* ---------------------------------------------------------------- XMP
 * ISO 16684-1; of spheres: https://developers.google.com/streetview/spherical-metadata */

#define XMP_MOST_BYTES 65536
#define BETWEEN " \t\r\n=>\"'"

/* The text behind NAME= or <NAME>, of a list its first item; NULL: it is not there. */
static const char *property(const char *xmp, const char *name)
{
	const char *at = strstr(xmp, name);

	if (!at)
		return NULL;
	at += strlen(name);
	at += strspn(at, BETWEEN);
	while (at[0] == '<' && at[1] != '/') {
		at += strcspn(at, ">");
		at += strspn(at, BETWEEN);
	}
	return at;
}

/* NAN: it is not there, or no number. */
static double number_of(const char *xmp, const char *name)
{
	const char *text = property(xmp, name);
	char *end = NULL;
	const double number = text ? strtod(text, &end) : NAN;

	return end != text ? number : NAN;
}

/* As number_of, and fractions: 1/250. */
static double rational_in(const char *xmp, const char *name)
{
	const char *text = property(xmp, name);
	char *end = NULL;
	double number = text ? strtod(text, &end) : NAN;

	if (end == text)
		return NAN;
	if (*end == '/')
		number /= strtod(end + 1, NULL);
	return isfinite(number) ? number : NAN;
}

/* What Exif says counts more; both say the same, or a program changed one of them. */
static void read_camera(struct lp_photo *photo, const char *xmp)
{
	const double orientation = number_of(xmp, "tiff:Orientation");
	double iso = number_of(xmp, "exif:ISOSpeedRatings");

	if (isnan(iso))
		iso = number_of(xmp, "exifEX:PhotographicSensitivity");
	if (photo->orientation == 0 && orientation >= 1.0 && orientation <= 8.0)
		photo->orientation = (int)orientation;
	complete(photo, rational_in(xmp, "exif:ExposureTime"),
		 rational_in(xmp, "exif:ShutterSpeedValue"), rational_in(xmp, "exif:FNumber"),
		 rational_in(xmp, "exif:ApertureValue"),
		 iso >= 1.0 && iso <= INT32_MAX ? (int)iso : 0);
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
	read_camera(photo, text);
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
