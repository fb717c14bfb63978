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

/* What a camera says: three entries, the first two of them fractions. */
struct said {
	uint32_t tag[3];
	int32_t fraction[2][2];
	uint32_t last_type, last;
};

/* 1/250 s, f/2, ISO 400. */
static const struct said direct = {{0x829a, 0x829d, 0x8827}, {{1, 250}, {20, 10}}, 3, 400};

/* And orientation 6. */
static void add_exif(struct bytes *jpeg, bool big_endian, const struct said *said)
{
	struct bytes exif = {.big_endian = big_endian};

	add(&exif, "Exif\0\0", 6);
	add(&exif, big_endian ? "MM\0*\0\0\0\10" : "II*\0\10\0\0\0", 8);
	number(&exif, 2, 2); /* at 8 */
	entry(&exif, 0x0112, 3, 6);
	entry(&exif, 0x8769, 4, 38);
	number(&exif, 0, 4);
	number(&exif, 3, 2); /* at 38 */
	entry(&exif, said->tag[0], 5, 80);
	entry(&exif, said->tag[1], 5, 88);
	entry(&exif, said->tag[2], said->last_type, said->last);
	number(&exif, 0, 4);
	for (int i = 0; i < 4; i++) /* at 80 */
		number(&exif, (uint32_t)said->fraction[i / 2][i % 2], 4);
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
		add_exif(&jpeg, big, &direct);
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

/* 2^-5 s and 2^(6/2) by their exponents; a compensation of exposure is none. */
static void test_apex(void **state)
{
	static const struct said apex = {{0x9201, 0x9202, 0x8832}, {{-50, -10}, {6, 1}}, 4, 102400};
	static const struct said compensation = {{0x9204, 0x9202, 0x8827},
						 {{-1, 3}, {6, 1}},
						 3,
						 100};
	static const struct said not_at_all = {{0x829a, 0x9201, 0x8827}, {{0, 1}, {7, 0}}, 3, 100};

	(void)state;
	for (int big = 0; big < 2; big++) {
		struct bytes jpeg = {.size = 2, .data = {0xff, 0xd8}};

		add_exif(&jpeg, big, &apex);
		const struct lp_photo photo = read_exact(&jpeg, jpeg.size);

		assert_float_equal(photo.exposure_us, 31250, 1e-2);
		assert_float_equal(photo.f_number, 8, 1e-6);
		assert_int_equal(photo.iso, 102400);
		jpeg.size = 2;
		add_exif(&jpeg, big, &compensation);
		assert_true(isnan(read_exact(&jpeg, jpeg.size).exposure_us));
		jpeg.size = 2;
		add_exif(&jpeg, big, &not_at_all);
		assert_true(isnan(read_exact(&jpeg, jpeg.size).exposure_us));
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

static void test_xmp_of_a_camera(void **state)
{
	struct lp_photo photo;

	(void)state;
	photo = photo_of("exif:ExposureTime=\"1/250\" exif:FNumber='28/10' tiff:Orientation=\"6\"");
	assert_float_equal(photo.exposure_us, 4000, 1e-3);
	assert_float_equal(photo.f_number, 2.8, 1e-6);
	assert_int_equal(photo.iso, 0);
	assert_int_equal(photo.orientation, 6);
	photo = photo_of(
		"<exif:ShutterSpeedValue>5/1</exif:ShutterSpeedValue> "
		"<exif:ApertureValue>6/1</exif:ApertureValue> <exif:ISOSpeedRatings>\n <rdf:Seq>"
		"\n  <rdf:li>400</rdf:li></rdf:Seq></exif:ISOSpeedRatings>");
	assert_float_equal(photo.exposure_us, 31250, 1e-2);
	assert_float_equal(photo.f_number, 8, 1e-6);
	assert_int_equal(photo.iso, 400);
	photo = photo_of("exif:ExposureTime=\"0/1\" exif:ExposureBiasValue=\"1/3\" "
			 "exif:ShutterSpeedValue=\"1/0\" tiff:Orientation=\"9\"");
	assert_true(isnan(photo.exposure_us));
	assert_int_equal(photo.orientation, 0);
}

static void test_exif_counts_more_than_xmp(void **state)
{
	(void)state;
	for (int exif_first = 0; exif_first < 2; exif_first++) {
		struct bytes jpeg = {.size = 2, .data = {0xff, 0xd8}};

		if (exif_first)
			add_exif(&jpeg, false, &direct);
		add_xmp(&jpeg, "exif:ExposureTime=\"1/8\" tiff:Orientation=\"3\"");
		if (!exif_first)
			add_exif(&jpeg, false, &direct);
		const struct lp_photo photo = read_exact(&jpeg, jpeg.size);

		assert_float_equal(photo.exposure_us, 4000, 1e-3);
		assert_int_equal(photo.orientation, 6);
	}
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
		cmocka_unit_test(test_apex),
		cmocka_unit_test(test_xmp_of_a_camera),
		cmocka_unit_test(test_exif_counts_more_than_xmp),
		cmocka_unit_test(test_parts_of_a_sphere),
		cmocka_unit_test(test_parts_that_make_no_sense),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
