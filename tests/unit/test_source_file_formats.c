/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <stdlib.h>

#include "drivers/source/formats.h"

/* The smallest stream of markers that is a JPEG to the splitter: 6x4 pixels, an APP1 segment with a
 * thumbnail in it, entropy data with stuffing, a restart marker and a fill byte. */
static const uint8_t jpeg[] = {
	0xff, 0xd8,							  /* SOI */
	0xff, 0xe1, 0,	  10, 'x', 0xff, 0xd8, 0xff, 0xd9, 0,	 0,    0, /* APP1 with SOI and EOI
									     inside */
	0xff, 0xff, 0xc0, 0,  11,  8,	 0,    4,    0,	   6,	 1,    1, 0x11, 0, /* fill, SOF0 */
	0xff, 0xda, 0,	  8,  1,   1,	 0,    0,    63,   0,			   /* SOS */
	1,    2,    0xff, 0,  3,   0xff, 0xd0, 4,    0xff, 0xff, 0x00, 5, /* stuffing, RST0, fill
									     before 0 */
	0xff, 0xd9,							  /* EOI */
};

struct stream {
	uint8_t bytes[1024];
	size_t size;
};

static void add(struct stream *stream, const void *bytes, size_t size)
{
	assert_true(stream->size + size <= sizeof(stream->bytes));
	memcpy(stream->bytes + stream->size, bytes, size);
	stream->size += size;
}

static int next_jpeg(const struct stream *stream, size_t from, size_t to, bool at_end,
		     struct lp_picture *picture)
{
	/* An exact copy, so that the sanitizer sees a read past its end. */
	uint8_t *copy = malloc(to - from + (to == from));
	int ret;

	memcpy(copy, stream->bytes + from, to - from);
	ret = lp_picture_next(LP_ENCODING_MJPEG, 0, 0, copy, to - from, at_end, picture);
	free(copy);
	return ret;
}

static void test_one_jpeg_and_every_part_of_it(void **state)
{
	struct stream stream = {0};
	struct lp_picture picture;

	(void)state;
	add(&stream, jpeg, sizeof(jpeg));
	assert_int_equal(next_jpeg(&stream, 0, stream.size, true, &picture), 1);
	assert_int_equal(picture.format, LP_FORMAT_MJPEG);
	assert_int_equal(picture.width_px, 6);
	assert_int_equal(picture.height_px, 4);
	assert_int_equal(picture.skip_bytes, 0);
	assert_int_equal(picture.encoded_bytes, sizeof(jpeg));
	assert_false(picture.corrupt);
	for (size_t size = 0; size < sizeof(jpeg); size++) {
		assert_int_equal(next_jpeg(&stream, 0, size, false, &picture), 0);
		if (size < 3) {
			assert_int_equal(next_jpeg(&stream, 0, size, true, &picture), -ENODATA);
			continue;
		}
		assert_int_equal(next_jpeg(&stream, 0, size, true, &picture), 1);
		assert_true(picture.corrupt);
		assert_int_equal(picture.encoded_bytes, size);
	}
}

static void test_garbage_between_jpegs_is_skipped(void **state)
{
	const uint8_t garbage[] = {0, 0xff, 0xd8, 1, 0xff};
	struct stream stream = {0};
	struct lp_picture picture;

	(void)state;
	add(&stream, garbage, sizeof(garbage));
	add(&stream, jpeg, sizeof(jpeg));
	add(&stream, garbage, sizeof(garbage));
	assert_int_equal(next_jpeg(&stream, 0, stream.size, true, &picture), 1);
	assert_int_equal(picture.skip_bytes, sizeof(garbage));
	assert_int_equal(picture.encoded_bytes, sizeof(jpeg));
	assert_false(picture.corrupt);
	assert_int_equal(next_jpeg(&stream, sizeof(garbage) + sizeof(jpeg), stream.size, false,
				   &picture),
			 0);
	assert_true(picture.skip_bytes >= sizeof(garbage) - 2);
	assert_int_equal(next_jpeg(&stream, sizeof(garbage) + sizeof(jpeg), stream.size, true,
				   &picture),
			 -ENODATA);
}

static bool cut_in_length(size_t cut)
{
	return cut == 4 || cut == 5 || cut == 17 || cut == 18 || cut == 30 || cut == 31;
}

/* A picture cut off in the middle must not swallow the one behind it. */
static void test_truncated_jpeg_ends_where_the_next_begins(void **state)
{
	(void)state;
	for (size_t cut = 3; cut < sizeof(jpeg); cut++) {
		struct stream stream = {0};
		struct lp_picture picture;
		size_t at = 0;
		int good = 0, bad = 0;

		add(&stream, jpeg, cut);
		for (int i = 0; i < 3; i++)
			add(&stream, jpeg, sizeof(jpeg));
		while (next_jpeg(&stream, at, stream.size, true, &picture) == 1) {
			at += picture.skip_bytes + picture.encoded_bytes;
			good += !picture.corrupt;
			bad += picture.corrupt;
		}
		/* A length that the cut made up may reach over everything; nothing else may. */
		if (cut_in_length(cut))
			good += 2;
		if (good < 2)
			fail_msg("cut after %zu bytes: %d good, %d bad", cut, good, bad);
		assert_true(good + bad >= 3);
	}
}

static void test_jpeg_without_size_is_corrupt(void **state)
{
	const uint8_t comment[] = {0xff, 0xd8, 0xff, 0xfe, 0, 2, 0xff, 0xd9};
	struct stream stream = {0};
	struct lp_picture picture;

	(void)state;
	add(&stream, comment, sizeof(comment));
	assert_int_equal(next_jpeg(&stream, 0, stream.size, true, &picture), 1);
	assert_true(picture.corrupt);
}

/* Encoders of capture cards send them. */
static void test_empty_jpegs_are_no_pictures(void **state)
{
	const uint8_t empty[] = {0xff, 0xd8, 0xff, 0xd9}, filled[] = {0xff, 0xd8, 0xff, 0xff, 0xd9};
	struct stream stream = {0};
	struct lp_picture picture;

	(void)state;
	add(&stream, empty, sizeof(empty));
	assert_int_equal(next_jpeg(&stream, 0, stream.size, true, &picture), -ENODATA);
	add(&stream, filled, sizeof(filled));
	assert_int_equal(next_jpeg(&stream, 0, stream.size, true, &picture), -ENODATA);
	add(&stream, jpeg, sizeof(jpeg));
	assert_int_equal(next_jpeg(&stream, 0, stream.size, true, &picture), 1);
	assert_int_equal(picture.skip_bytes, sizeof(empty) + sizeof(filled));
	assert_false(picture.corrupt);
}

static void test_raw_sizes(void **state)
{
	static const struct {
		enum lp_encoding encoding;
		enum lp_pixel_format format;
		size_t bytes, stride;
	} cases[] = {
		{LP_ENCODING_YUYV, LP_FORMAT_YUYV, 30, 10},
		{LP_ENCODING_NV12, LP_FORMAT_NV12, 15 + 12, 5},
		{LP_ENCODING_GREY, LP_FORMAT_GREY, 15, 5},
	};
	const uint8_t bytes[64] = {0};
	struct lp_picture picture;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		const enum lp_encoding encoding = cases[i].encoding;

		assert_int_equal(lp_picture_next(encoding, 5, 3, bytes, 64, false, &picture), 1);
		assert_int_equal(picture.format, cases[i].format);
		assert_int_equal(picture.encoded_bytes, cases[i].bytes);
		assert_int_equal(picture.frame_bytes, cases[i].bytes);
		assert_int_equal(picture.stride_bytes, cases[i].stride);
		assert_false(picture.corrupt);
		assert_int_equal(lp_picture_next(encoding, 5, 3, bytes, cases[i].bytes - 1, false,
						 &picture),
				 0);
		assert_int_equal(lp_picture_next(encoding, 5, 3, bytes, cases[i].bytes - 1, true,
						 &picture),
				 1);
		assert_true(picture.corrupt);
		assert_int_equal(lp_picture_next(encoding, 5, 3, bytes, 0, true, &picture),
				 -ENODATA);
		assert_int_equal(lp_picture_next(encoding, 0, 0, bytes, 64, true, &picture),
				 -EBADMSG);
		assert_int_equal(lp_picture_next(encoding, 65535, 65535, bytes, 64, true, &picture),
				 -EBADMSG);
	}
}

static size_t make_pfm(uint8_t *out, const char *header, const float *samples, size_t count,
		       bool swap)
{
	const size_t length = strlen(header);

	memcpy(out, header, length);
	for (size_t i = 0; i < count; i++) {
		uint32_t bits;

		memcpy(&bits, &samples[i], 4);
		if (swap)
			bits = __builtin_bswap32(bits);
		memcpy(out + length + 4 * i, &bits, 4);
	}
	return length + 4 * count;
}

static void test_pfm_colour_both_endiannesses(void **state)
{
	/* Two columns, two rows; the file's first row is the lower one. */
	const float samples[] = {7, 8, 9, 10, 11, 12, 1, 2, 3, 4, 5, 6};
	static const char *const headers[] = {"PF\n2 2\n-1.0\n", "PF 2 2 1\n"};
	uint8_t file[256];
	float frame[12];

	(void)state;
	for (int big = 0; big < 2; big++) {
		const size_t size = make_pfm(file, headers[big], samples, 12, big);
		struct lp_picture picture;

		assert_int_equal(lp_picture_next(LP_ENCODING_PFM, 0, 0, file, size, true, &picture),
				 1);
		assert_int_equal(picture.format, LP_FORMAT_RGB_F32);
		assert_int_equal(picture.encoded_bytes, size);
		assert_int_equal(picture.frame_bytes, sizeof(frame));
		assert_int_equal(picture.stride_bytes, 24);
		lp_picture_copy(&picture, file, (uint8_t *)frame);
		for (int i = 0; i < 12; i++)
			assert_true(frame[i] == (float)(i + 1));
	}
}

static void test_pfm_grey_becomes_rgb_and_scale_counts(void **state)
{
	const float samples[] = {1, 2};
	uint8_t file[64];
	float frame[6];
	const size_t size = make_pfm(file, "Pf\n1 2\n-0.5\n", samples, 2, false);
	struct lp_picture picture;

	(void)state;
	assert_int_equal(lp_picture_next(LP_ENCODING_PFM, 0, 0, file, size, true, &picture), 1);
	lp_picture_copy(&picture, file, (uint8_t *)frame);
	for (int i = 0; i < 6; i++)
		assert_true(frame[i] == (i < 3 ? 1.0F : 0.5F));
}

static void test_pfm_truncated_and_bad_headers(void **state)
{
	static const char *const bad[] = {"PX\n1 1\n-1\n",  "PF\n0 1\n-1\n",  "PF\n1 99999\n-1\n",
					  "PF\n1 1\n0\n",   "PF\n1 1\nnan\n", "P6\n1 1\n255\n",
					  "PF\n-1 1\n-1\n", "PF\nx y\n-1\n"};
	const float samples[3] = {1, 2, 3};
	uint8_t file[256];
	const size_t size = make_pfm(file, "PF\n1 1\n-1\n", samples, 3, false);
	struct lp_picture picture;

	(void)state;
	for (size_t cut = 0; cut < size; cut++) {
		uint8_t *copy = malloc(cut + 1);

		memcpy(copy, file, cut);
		assert_int_equal(lp_picture_next(LP_ENCODING_PFM, 0, 0, copy, cut, false, &picture),
				 0);
		const int ret = lp_picture_next(LP_ENCODING_PFM, 0, 0, copy, cut, true, &picture);

		if (cut == 0)
			assert_int_equal(ret, -ENODATA);
		else
			assert_true(ret == -EBADMSG || (ret == 1 && picture.corrupt));
		free(copy);
	}
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		memset(file, ' ', sizeof(file));
		memcpy(file, bad[i], strlen(bad[i]));
		assert_int_equal(lp_picture_next(LP_ENCODING_PFM, 0, 0, file, sizeof(file), true,
						 &picture),
				 -EBADMSG);
	}
}

static void test_encoding_by_name_and_by_bytes(void **state)
{
	const uint8_t soi[] = {0xff, 0xd8, 0xff};

	(void)state;
	assert_int_equal(lp_encoding_of("a/b.JPG", NULL, 0), LP_ENCODING_JPEG);
	assert_int_equal(lp_encoding_of("stream.mjpeg", NULL, 0), LP_ENCODING_MJPEG);
	assert_int_equal(lp_encoding_of("x.nv12", NULL, 0), LP_ENCODING_NV12);
	assert_int_equal(lp_encoding_of("x.pfm", NULL, 0), LP_ENCODING_PFM);
	assert_int_equal(lp_encoding_of("x", soi, 3), LP_ENCODING_JPEG);
	assert_int_equal(lp_encoding_of("x.bin", (const uint8_t *)"Pf\n", 3), LP_ENCODING_PFM);
	assert_int_equal(lp_encoding_of("x.png", (const uint8_t *)"\x89PN", 3),
			 LP_ENCODING_UNKNOWN);
	assert_int_equal(lp_encoding_of("jpg", NULL, 0), LP_ENCODING_UNKNOWN);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_one_jpeg_and_every_part_of_it),
		cmocka_unit_test(test_garbage_between_jpegs_is_skipped),
		cmocka_unit_test(test_truncated_jpeg_ends_where_the_next_begins),
		cmocka_unit_test(test_empty_jpegs_are_no_pictures),
		cmocka_unit_test(test_jpeg_without_size_is_corrupt),
		cmocka_unit_test(test_raw_sizes),
		cmocka_unit_test(test_pfm_colour_both_endiannesses),
		cmocka_unit_test(test_pfm_grey_becomes_rgb_and_scale_counts),
		cmocka_unit_test(test_pfm_truncated_and_bad_headers),
		cmocka_unit_test(test_encoding_by_name_and_by_bytes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
