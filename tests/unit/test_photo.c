/* SPDX-License-Identifier: Apache-2.0 */
/* What a photo says of itself, in either byte order, whole and cut off. */
#include "drivers/source/photo.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "lp_test.h"

struct bytes {
	uint8_t data[4096];
	size_t size;
	bool big_endian;
};

static void add(struct bytes *b, const void *data, size_t size)
{
	memcpy(b->data + b->size, data, size);
	b->size += size;
}

static void number(struct bytes *b, uint32_t value, int size)
{
	for (int i = 0; i < size; i++)
		b->data[b->size++] = (uint8_t)(value >> 8 * (b->big_endian ? size - 1 - i : i));
}

static void entry(struct bytes *b, uint32_t tag, uint32_t type, uint32_t value)
{
	number(b, tag, 2);
	number(b, type, 2);
	number(b, 1, 4);
	number(b, value, type == 3 ? 2 : 4);
	number(b, 0, type == 3 ? 2 : 0);
}

/* A JPEG's APP1 around `content`. */
static void segment(struct bytes *jpeg, const void *content, size_t size)
{
	const uint8_t head[] = {0xff, 0xe1, (uint8_t)((size + 2) >> 8), (uint8_t)(size + 2)};

	add(jpeg, head, 4);
	add(jpeg, content, size);
}

/* 1/250 s, f/2, ISO 400, orientation 6. */
static void add_exif(struct bytes *jpeg, bool big_endian)
{
	struct bytes exif = {.big_endian = big_endian};

	add(&exif, "Exif\0\0", 6);
	add(&exif, big_endian ? "MM\0*\0\0\0\10" : "II*\0\10\0\0\0", 8);
	number(&exif, 2, 2); /* at 8 */
	entry(&exif, 0x0112, 3, 6);
	entry(&exif, 0x8769, 4, 38);
	number(&exif, 0, 4);
	number(&exif, 3, 2); /* at 38 */
	entry(&exif, 0x829a, 5, 80);
	entry(&exif, 0x829d, 5, 88);
	entry(&exif, 0x8827, 3, 400);
	number(&exif, 0, 4);
	number(&exif, 1, 4); /* at 80 */
	number(&exif, 250, 4);
	number(&exif, 20, 4);
	number(&exif, 10, 4);
	segment(jpeg, exif.data, exif.size);
}

static void add_xmp(struct bytes *jpeg, const char *properties)
{
	char text[2048];
	const int mark = 29; /* with its zero */
	const int size = snprintf(text, sizeof(text),
				  "http://ns.adobe.com/xap/1.0/ <x:xmpmeta xmlns:GPano=\""
				  "http://ns.google.com/photos/1.0/panorama/\" %s/>",
				  properties);

	text[mark - 1] = '\0';
	segment(jpeg, text, (size_t)size);
}

static struct lp_photo read_exact(const struct bytes *jpeg, size_t size)
{
	uint8_t *copy = malloc(size + (size == 0)); /* the sanitizer sees a read beyond it */
	struct lp_photo photo;

	memcpy(copy, jpeg->data, size);
	photo = lp_photo_read(copy, size);
	free(copy);
	return photo;
}

static void test_exif(void **state)
{
	(void)state;
	for (int big = 0; big < 2; big++) {
		struct bytes jpeg = {0};

		add(&jpeg, "\xff\xd8\xff", 3); /* and a fill byte */
		add_exif(&jpeg, big);
		const struct lp_photo photo = read_exact(&jpeg, jpeg.size);

		assert_float_equal(photo.exposure_us, 4000, 1e-3);
		assert_float_equal(photo.f_number, 2, 1e-6);
		assert_int_equal(photo.iso, 400);
		assert_int_equal(photo.orientation, 6);
		assert_false(photo.crop.width != 0.0F);
		for (size_t size = 0; size < jpeg.size; size++)
			assert_true(isnan(read_exact(&jpeg, size).exposure_us));
	}
}

static bool makes_no_sense(struct lp_photo photo)
{
	return lp_crop_is_unusable(&photo.crop);
}

static struct lp_photo photo_of(const char *properties)
{
	struct bytes jpeg = {0};

	add(&jpeg, "\xff\xd8", 2);
	add_xmp(&jpeg, properties);
	for (size_t size = 0; size < jpeg.size; size++)
		assert_false(makes_no_sense(read_exact(&jpeg, size)));
	return read_exact(&jpeg, jpeg.size);
}

#define CROP(left, top, width, height)                                                 \
	"GPano:FullPanoWidthPixels=\"8000\" GPano:FullPanoHeightPixels='4000' "        \
	"GPano:CroppedAreaLeftPixels=\"" #left "\" GPano:CroppedAreaTopPixels=\"" #top \
	"\" GPano:CroppedAreaImageWidthPixels=\"" #width                               \
	"\" <GPano:CroppedAreaImageHeightPixels>" #height "</GPano:CroppedAreaImageHeightPixels>"

static void test_parts_of_a_sphere(void **state)
{
	struct lp_photo photo;

	(void)state;
	photo = photo_of(CROP(2000, 1000, 4000, 2000));
	assert_float_equal(photo.crop.left, 0.25, 1e-6);
	assert_float_equal(photo.crop.top, 0.25, 1e-6);
	assert_float_equal(photo.crop.width, 0.5, 1e-6);
	assert_float_equal(photo.crop.height, 0.5, 1e-6);
	assert_false(lp_crop_is_unusable(&photo.crop));
	photo = photo_of(CROP(0, 0, 8000, 4000));
	assert_true(lp_crop_is_whole(&photo.crop));
	photo = photo_of(CROP(7000, 0, 4000, 4000)); /* across the seam */
	assert_float_equal(photo.crop.left, 0.875, 1e-6);
}

static void test_parts_that_make_no_sense(void **state)
{
	(void)state;
	assert_true(makes_no_sense(photo_of(CROP(0, 0, 9000, 4000))));
	assert_true(makes_no_sense(photo_of(CROP(0, 3000, 4000, 2000))));
	assert_true(makes_no_sense(photo_of(CROP(-1, 0, 4000, 2000))));
	assert_true(makes_no_sense(photo_of(CROP(0, 0, 0, 0))));
	assert_true(makes_no_sense(photo_of("GPano:FullPanoWidthPixels=\"8000\"")));
	assert_true(makes_no_sense(photo_of("GPano:ProjectionType=\"cylindrical\"")));
	assert_false(makes_no_sense(photo_of("GPano:ProjectionType=\"equirectangular\"")));
	assert_false(makes_no_sense(photo_of("")));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_exif),
		cmocka_unit_test(test_parts_of_a_sphere),
		cmocka_unit_test(test_parts_that_make_no_sense),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
