/* SPDX-License-Identifier: Apache-2.0 */
/* Whether a JPEG counts, or is damaged: the same answer however it is decoded, also where libjpeg
 * only warns. */
#include "vision/exposure.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "include/frame.h"
#include "jpeg_encode.h"
#include "lp_test.h"
#include "vision/camera/camera.h"
#include "vision/camera/response.h"

#define WIDTH_PX 96
#define HEIGHT_PX 64
#define MOST_BYTES 65536

/* The ways of decoding that presets and small pictures come to. */
static const struct lp_decode_options ways[] = {
	{LP_DECODE_BLOCKS, 0, 8, 0}, {LP_DECODE_BLOCKS, 0, 8, 1000}, {LP_DECODE_PIXELS, 1, 8, 0},
	{LP_DECODE_PIXELS, 2, 8, 0}, {LP_DECODE_PIXELS, 4, 8, 0},    {LP_DECODE_PIXELS, 8, 8, 0},
	{LP_DECODE_BLOCKS, 0, 4, 0}, {LP_DECODE_BLOCKS, 0, 4, 1000}, {LP_DECODE_PIXELS, 1, 4, 0},
};
enum { QUARTERS = 6, EXACT_QUARTERS, PIXEL_QUARTERS };
#define WAYS LP_COUNT(ways)

/* By libjpeg with and without planes; with restart markers; and what only libjpeg reads. */
static const struct jpeg_kind kinds[] = {
	{3, 2, 1, 90, 0, 0, 0}, {3, 2, 2, 85, 4, 0, 0}, {3, 1, 1, 95, 0, 0, 0},
	{1, 1, 1, 85, 3, 0, 0}, {3, 2, 2, 85, 0, 0, 1},
};

struct stream {
	uint8_t bytes[MOST_BYTES];
	size_t size;
	unsigned int width_px, height_px;
};

static struct lp_exposure exposures[WAYS];
static struct lp_response response;

static int setup(void **state)
{
	struct lp_camera *camera;

	(void)state;
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	lp_response_init(&response, camera);
	lp_camera_destroy(camera);
	return 0;
}

static int teardown(void **state)
{
	(void)state;
	for (size_t i = 0; i < WAYS; i++)
		lp_exposure_release(&exposures[i]);
	return 0;
}

static void keep(struct lp_frame *frame)
{
	(void)frame;
}

/* The mean of green of all cells, or -EBADMSG. */
static double decode(const struct stream *stream, size_t way)
{
	static uint8_t seen[WIDTH_PX * HEIGHT_PX];
	uint8_t *exact = malloc(stream->size); /* the sanitizer sees a read beyond it */
	struct lp_frame frame = {.format = LP_FORMAT_MJPEG,
				 .width_px = stream->width_px,
				 .height_px = stream->height_px,
				 .data = exact,
				 .size_bytes = stream->size,
				 .exposure_us = NAN,
				 .gain = NAN,
				 .release = keep};
	struct lp_exposure *exposure = &exposures[way];
	double sum = 0.0;

	memcpy(exact, stream->bytes, stream->size);
	memset(seen, 0xff, sizeof(seen));
	exposure->scale = 1.0F;
	const int ret = lp_exposure_load(exposure, &frame, &ways[way], NULL, seen, &response);
	const int cells = exposure->cells.width * exposure->cells.height;

	free(exact);
	assert_true(ret == 0 || ret == -EBADMSG);
	for (int i = 0; ret == 0 && i < cells; i++)
		sum += (double)exposure->cells.radiance[i][1];
	return ret < 0 ? ret : sum / cells;
}

/* Of the first way; fails where another way has another answer. */
static double verdict(const struct stream *stream, const char *what)
{
	struct capture capture;
	double means[WAYS];

	capture_begin(&capture); /* what is refused is logged */
	for (size_t i = 0; i < WAYS; i++)
		means[i] = decode(stream, i);
	capture_end(&capture);
	const double first = means[0];

	for (size_t i = 1; i < WAYS; i++) {
		const double other = means[i];

		if ((first < 0) != (other < 0))
			fail_msg("%s: %g by way 0, %g by way %zu", what, first, other, i);
	}
	return first;
}

static void encode_of(const struct jpeg_kind *kind, unsigned int width_px, unsigned int height_px,
		      struct stream *stream)
{
	unsigned long size;
	uint8_t *data = encode_jpeg(kind, (int)width_px, (int)height_px, &size);

	assert_true(size + 4096 < MOST_BYTES);
	memcpy(stream->bytes, data, size);
	stream->size = size;
	stream->width_px = width_px;
	stream->height_px = height_px;
	free(data);
}

static void encode(const struct jpeg_kind *kind, struct stream *stream)
{
	encode_of(kind, WIDTH_PX, HEIGHT_PX, stream);
}

static void insert(struct stream *stream, size_t at, const void *bytes, size_t size)
{
	memmove(stream->bytes + at + size, stream->bytes + at, stream->size - at);
	memcpy(stream->bytes + at, bytes, size);
	stream->size += size;
}

/* Behind the last MCU before each restart marker, and before the end. Returns how many places. */
static int insert_before_markers(struct stream *stream, const void *bytes, size_t size)
{
	int places = 0;

	for (size_t at = 0; at + 1 < stream->size; at++) {
		const uint8_t marker = stream->bytes[at + 1];

		if (stream->bytes[at] != 0xff ||
		    ((marker < 0xd0 || marker > 0xd7) && marker != 0xd9))
			continue;
		insert(stream, at, bytes, size);
		at += size;
		places++;
	}
	return places;
}

static const uint8_t extraneous[] = {0x12, 0x34, 0, 1, 2, 3, 0x56, 0x78};

static void test_what_cameras_add_is_no_damage(void **state)
{
	static const uint8_t empty[] = {0xff, 0xd8, 0xff, 0xd9, 0xff, 0xd8, 0xff, 0xff, 0xd9};
	static uint8_t padding[600];
	static struct stream stream;

	(void)state;
	for (size_t k = 0; k < 4; k++) {
		encode(&kinds[k], &stream);
		const double plain = verdict(&stream, "plain");

		assert_true(plain > 0);
		for (size_t size = 1; size <= sizeof(extraneous); size++) {
			encode(&kinds[k], &stream);
			assert_true(insert_before_markers(&stream, extraneous, size) >= 1);
			assert_float_equal(verdict(&stream, "extraneous bytes"), plain, 1e-6);
		}
		encode(&kinds[k], &stream);
		insert(&stream, 0, empty, sizeof(empty));
		assert_float_equal(verdict(&stream, "empty JPEGs before"), plain, 1e-6);
		insert(&stream, 0, "\r\n\0", 3);
		assert_float_equal(verdict(&stream, "and other bytes"), plain, 1e-6);
		insert(&stream, stream.size, padding, sizeof(padding));
		assert_float_equal(verdict(&stream, "padding behind"), plain, 1e-6);
		encode(&kinds[k], &stream);
		stream.size -= 2;
		assert_float_equal(verdict(&stream, "no EOI"), plain, 1e-6);
	}
}

/* Many bytes too many are another picture's: something is missing between. */
static void test_much_too_much_is_damage(void **state)
{
	static const uint8_t much[40] = {1, 2, 3};
	static struct stream stream;

	(void)state;
	for (size_t k = 0; k < 4; k++) {
		encode(&kinds[k], &stream);
		insert(&stream, stream.size - 2, much, sizeof(much));
		assert_true(verdict(&stream, "40 bytes before EOI") < 0);
	}
	stream.size = 4;
	memcpy(stream.bytes, "\xff\xd8\xff\xd9", 4);
	assert_true(verdict(&stream, "nothing but an empty JPEG") < 0);
}

static void damage(struct stream *stream, int how)
{
	const size_t head = stream->size > 800 ? 700 : stream->size / 2;
	const size_t at = head + (size_t)rand() % (stream->size - head);
	const size_t most = stream->size - at,
		     length = 1 + (size_t)rand() % (most < 64 ? most : 64);

	switch (how) {
	case 0: /* a packet is lost */
		memmove(stream->bytes + at, stream->bytes + at + length, most - length);
		stream->size -= length;
		break;
	case 1: /* or filled */
		memset(stream->bytes + at, 0, length);
		break;
	case 2: /* or from elsewhere */
		memmove(stream->bytes + at, stream->bytes + head / 2, length);
		break;
	case 3:
		stream->bytes[at] ^= (uint8_t)(1 << rand() % 8);
		break;
	default:
		stream->size = at;
		break;
	}
}

static void test_all_ways_agree_about_damage(void **state)
{
	static struct stream stream;
	int whole = 0, refused = 0;

	(void)state;
	srand(7);
	for (size_t k = 0; k < LP_COUNT(kinds); k++)
		for (int n = 0; n < 500; n++) {
			encode(&kinds[k], &stream);
			damage(&stream, n % 5);
			*(verdict(&stream, "damage") < 0 ? &refused : &whole) += 1;
		}
	assert_true(whole > 100 && refused > 1000);
}

/* Light of a cell, green, by two ways. */
static double difference(size_t way, size_t other, int cell)
{
	return fabs((double)exposures[way].cells.radiance[cell][1] -
		    (double)exposures[other].cells.radiance[cell][1]);
}

/* The quarters of blocks are where the pixels say that they are, whatever the picture's sides; and
 * without a look at pixels their light is that of the whole. */
static void test_quarters_of_blocks_hold_the_light_of_their_pixels(void **state)
{
	static const unsigned int sizes[][2] = {{96, 64}, {90, 61}, {35, 33}, {5, 3}};
	static struct stream stream;

	(void)state;
	for (size_t n = 0; n < LP_COUNT(sizes); n++)
		for (size_t k = 0; k < LP_COUNT(kinds); k++) {
			encode_of(&kinds[k], sizes[n][0], sizes[n][1], &stream);
			const double mean = decode(&stream, PIXEL_QUARTERS);
			const double quarters = decode(&stream, QUARTERS);
			const struct lp_cells *cells = &exposures[PIXEL_QUARTERS].cells;
			const int count = cells->width * cells->height;
			double off = 0.0;

			assert_true(decode(&stream, EXACT_QUARTERS) > 0);
			for (size_t way = QUARTERS; way <= EXACT_QUARTERS; way++) {
				assert_int_equal(exposures[way].cells.width, cells->width);
				assert_int_equal(exposures[way].cells.height, cells->height);
			}
			for (int i = 0; i < count; i++)
				off += difference(EXACT_QUARTERS, PIXEL_QUARTERS, i) / count;
			assert_true(off < 0.02);
			assert_float_equal(quarters, mean, 0.005);
		}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_what_cameras_add_is_no_damage),
		cmocka_unit_test(test_much_too_much_is_damage),
		cmocka_unit_test(test_all_ways_agree_about_damage),
		cmocka_unit_test(test_quarters_of_blocks_hold_the_light_of_their_pixels),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
