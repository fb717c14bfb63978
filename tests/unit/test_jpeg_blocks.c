/* SPDX-License-Identifier: Apache-2.0 */
/* The block reader against libjpeg-turbo: DC bit for bit, energy and pixels within what they
 * promise. */
#include "vision/jpeg/blocks.h"

#include <errno.h>
#include <math.h>

#include "jpeg_encode.h"
#include "lp_test.h"
#include "vision/jpeg/pixels.h"

static const struct jpeg_kind kinds[] = {
	{3, 2, 2, 85, 0, 0, 0},	 {3, 2, 1, 90, 0, 0, 0},  {3, 1, 1, 95, 0, 0, 0},
	{3, 1, 2, 80, 0, 0, 0},	 {1, 1, 1, 85, 0, 0, 0},  {1, 2, 2, 85, 0, 0, 0},
	{3, 2, 2, 85, 1, 0, 0},	 {3, 2, 2, 85, 7, 0, 0},  {3, 2, 1, 85, 1000, 0, 0},
	{3, 2, 2, 50, 0, 1, 0},	 {3, 2, 2, 100, 0, 1, 0}, {3, 2, 1, 5, 3, 1, 0},
	{1, 1, 1, 100, 5, 1, 0},
};
static const int sizes[][2] = {{256, 128}, {250, 121}, {8, 8},	   {1, 1},
			       {17, 9},	   {640, 48},  {1280, 640}};

struct coefficients {
	struct jpeg_decompress_struct info;
	struct jpeg_error_mgr errors;
	jvirt_barray_ptr *arrays;
};

static void read_coefficients(struct coefficients *c, const uint8_t *data, unsigned long size)
{
	c->info.err = jpeg_std_error(&c->errors);
	jpeg_create_decompress(&c->info);
	jpeg_mem_src(&c->info, data, size);
	jpeg_read_header(&c->info, TRUE);
	c->arrays = jpeg_read_coefficients(&c->info);
}

static JCOEFPTR block_of(struct coefficients *c, int component, int row, int column)
{
	JBLOCKARRAY rows = c->info.mem->access_virt_barray((j_common_ptr)&c->info,
							   c->arrays[component], row, 1, FALSE);

	return rows[0][column];
}

static void compare_component(const struct lp_jpeg_reader *reader, struct coefficients *c, int k)
{
	const jpeg_component_info *theirs = &c->info.comp_info[k];
	const struct lp_jpeg_component *ours = &reader->component[k];

	assert_int_equal(ours->dc_step, theirs->quant_table->quantval[0]);
	for (JDIMENSION y = 0; y < theirs->height_in_blocks; y++)
		for (JDIMENSION x = 0; x < theirs->width_in_blocks; x++) {
			const JCOEFPTR block = block_of(c, k, (int)y, (int)x);
			double energy = 0.0;

			assert_int_equal(ours->dc[y * ours->blocks_x + x], block[0]);
			for (int i = 1; i < 64 && k == 0; i++) {
				const double v =
					(double)block[i] * theirs->quant_table->quantval[i];

				energy += v * v;
			}
			if (k == 0 && energy == 0.0)
				assert_int_equal(reader->energy[y * ours->blocks_x + x], 0);
		}
}

static void test_dc_is_libjpegs(void **state)
{
	struct lp_jpeg_reader *reader;

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (unsigned int k = 0; k < LP_COUNT(kinds); k++)
		for (unsigned int s = 0; s < LP_COUNT(sizes); s++) {
			struct coefficients c;
			unsigned long size;
			uint8_t *data = encode_jpeg(&kinds[k], sizes[s][0], sizes[s][1], &size);

			assert_int_equal(lp_jpeg_read(reader, data, size), 0);
			assert_int_equal(reader->width_px, sizes[s][0]);
			assert_int_equal(reader->height_px, sizes[s][1]);
			read_coefficients(&c, data, size);
			for (int i = 0; i < kinds[k].components; i++)
				compare_component(reader, &c, i);
			jpeg_destroy_decompress(&c.info);
			free(data);
		}
	lp_jpeg_reader_destroy(reader);
}

/* The energy is read from symbols, several at a time: right on the whole, block by block roughly.
 */
static void test_energy(void **state)
{
	const int qualities[] = {50, 75, 85, 95};
	struct lp_jpeg_reader *reader;

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (unsigned int q = 0; q < LP_COUNT(qualities); q++) {
		const struct jpeg_kind kind = {3, 2, 2, qualities[q], 0, 0, 0};
		double ours = 0.0, theirs = 0.0, deviation = 0.0;
		struct coefficients c;
		unsigned long size;
		uint8_t *data = encode_jpeg(&kind, 640, 320, &size);

		assert_int_equal(lp_jpeg_read(reader, data, size), 0);
		read_coefficients(&c, data, size);
		for (int y = 0; y < 40; y++)
			for (int x = 0; x < 80; x++) {
				const JCOEFPTR block = block_of(&c, 0, y, x);
				double energy = 0.0;

				for (int i = 1; i < 64; i++)
					energy += pow((double)block[i] *
							      c.info.comp_info[0]
								      .quant_table->quantval[i],
						      2);
				const double read =
					(double)reader->energy[y * 80 + x] / LP_ENERGY_STEPS;

				ours += read;
				theirs += energy;
				deviation += fabs(read - energy);
			}
		assert_float_equal(ours / theirs, 1.0, 0.05);
		assert_true(deviation / theirs < 0.15);
		jpeg_destroy_decompress(&c.info);
		free(data);
	}
	lp_jpeg_reader_destroy(reader);
}

/* The first block of a stretch: its DC is coded anew, and with it what one probe passes. */
static bool begins_stretch(int x, int y, int mcus_x, int interval)
{
	return interval && x % 2 == 0 && y % 2 == 0 && (y / 2 * mcus_x + x / 2) % interval == 0;
}

/* However the data is cut into stretches, and from wherever they are walked through: the same
 * coefficients, so the same light to the last bit. */
static void test_stretches_do_not_matter(void **state)
{
	const int intervals[] = {0, 1, 7, 80, 1000, 3199};
	const size_t blocks = (size_t)160 * 80;
	struct lp_jpeg_reader *reader;
	int32_t *energy = malloc(blocks * sizeof(*energy));
	int16_t *dc = malloc(blocks * sizeof(*dc));

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (unsigned int i = 0; i < LP_COUNT(intervals); i++) {
		const struct jpeg_kind kind = {3, 2, 2, 90, intervals[i], 0, 0};
		unsigned long size;
		uint8_t *data = encode_jpeg(&kind, 1280, 640, &size);

		assert_int_equal(lp_jpeg_read(reader, data, size), 0);
		if (i == 0) {
			memcpy(energy, reader->energy, blocks * sizeof(*energy));
			memcpy(dc, reader->component[0].dc, blocks * sizeof(*dc));
		}
		for (int y = 0; y < 80; y++)
			for (int x = 0; x < 160; x++)
				if (!begins_stretch(x, y, 80, intervals[i]))
					assert_int_equal(reader->energy[y * 160 + x],
							 energy[y * 160 + x]);
		assert_memory_equal(reader->component[0].dc, dc, blocks * sizeof(*dc));
		free(data);
	}
	free(dc);
	free(energy);
	lp_jpeg_reader_destroy(reader);
}

/* Pixels of single blocks against the whole decoded picture; chroma is repeated in both. */
static void test_block_pixels(void **state)
{
	struct lp_jpeg_reader *reader;

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (unsigned int k = 0; k < LP_COUNT(kinds); k++) {
		const int width = 250, height = 121;
		struct jpeg_decompress_struct info;
		struct jpeg_error_mgr errors;
		unsigned long size;
		uint8_t *data = encode_jpeg(&kinds[k], width, height, &size);
		uint8_t *picture = malloc((size_t)width * height * 3);
		int worst = 0;

		info.err = jpeg_std_error(&errors);
		jpeg_create_decompress(&info);
		jpeg_mem_src(&info, data, size);
		jpeg_read_header(&info, TRUE);
		info.out_color_space = JCS_RGB;
		info.dct_method = JDCT_FLOAT;
		info.do_fancy_upsampling = FALSE;
		jpeg_start_decompress(&info);
		while (info.output_scanline < info.output_height) {
			JSAMPROW row[1] = {picture + (size_t)info.output_scanline * width * 3};
			jpeg_read_scanlines(&info, row, 1);
		}
		jpeg_destroy_decompress(&info);

		assert_int_equal(lp_jpeg_read(reader, data, size), 0);
		for (int by = 0; by < lp_jpeg_visible_blocks_y(reader, 0); by++)
			for (int bx = 0; bx < lp_jpeg_visible_blocks_x(reader, 0); bx++) {
				uint8_t rgb[64][3];

				lp_jpeg_block_rgb(reader, bx, by, rgb);
				for (int p = 0; p < 64; p++) {
					const int x = 8 * bx + p % 8, y = 8 * by + p / 8;

					for (int c = 0; c < 3 && x < width && y < height; c++) {
						const int e = abs(
							rgb[p][c] -
							picture[((size_t)y * width + x) * 3 + c]);
						worst = e > worst ? e : worst;
					}
				}
			}
		assert_true(worst <= 2); /* two roundings, of samples and of colour */
		free(picture);
		free(data);
	}
	lp_jpeg_reader_destroy(reader);
}

static void test_motion_jpeg_without_tables(void **state)
{
	const struct jpeg_kind kind = {3, 2, 1, 85, 0, 0, 0}, other = {3, 2, 1, 85, 0, 1, 0};
	struct lp_jpeg_reader *reader;
	unsigned long size, full_size;
	uint8_t *full = encode_jpeg(&kind, 128, 64, &full_size);
	uint8_t *data = encode_jpeg(&kind, 128, 64, &size);
	uint8_t *optimised;
	int16_t dc[128];

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	assert_int_equal(lp_jpeg_read(reader, full, full_size), 0);
	memcpy(dc, reader->component[0].dc, sizeof(dc));
	strip_dht(data, &size);
	assert_true(size < full_size);
	/* with own tables in between: the standard ones must come back */
	for (int round = 0; round < 2; round++) {
		unsigned long optimised_size;

		assert_int_equal(lp_jpeg_read(reader, data, size), 0);
		assert_memory_equal(dc, reader->component[0].dc, sizeof(dc));
		optimised = encode_jpeg(&other, 128, 64, &optimised_size);
		assert_int_equal(lp_jpeg_read(reader, optimised, optimised_size), 0);
		assert_memory_equal(dc, reader->component[0].dc, sizeof(dc));
		free(optimised);
	}
	free(data);
	free(full);
	lp_jpeg_reader_destroy(reader);
}

static void test_other_jpegs_are_left_to_libjpeg(void **state)
{
	const struct jpeg_kind progressive = {3, 2, 2, 85, 0, 0, 1}, wide = {3, 4, 1, 85, 0, 0, 0};
	struct lp_jpeg_reader *reader;
	unsigned long size;
	uint8_t *data = encode_jpeg(&progressive, 64, 64, &size);

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	assert_int_equal(lp_jpeg_read(reader, data, size), -ENOTSUP);
	assert_int_equal(reader->width_px, 0);
	free(data);
	data = encode_jpeg(&wide, 64, 64, &size);
	assert_int_equal(lp_jpeg_read(reader, data, size), -ENOTSUP);
	free(data);
	lp_jpeg_reader_destroy(reader);
}

/* Cut anywhere, the frame is refused; what is read is ours (AddressSanitizer watches). */
static void test_truncation(void **state)
{
	/* many restart segments; and one stretch, long enough to be read from two places */
	const struct jpeg_kind cut_kinds[] = {{3, 2, 2, 85, 4, 0, 0}, {3, 2, 1, 95, 0, 0, 0}};
	struct lp_jpeg_reader *reader;

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (unsigned int k = 0; k < LP_COUNT(cut_kinds); k++) {
		unsigned long size;
		uint8_t *data = encode_jpeg(&cut_kinds[k], 96, 64, &size);

		for (unsigned long cut = 0; cut + 3 < size; cut++) {
			uint8_t *part =
				malloc(cut ? cut : 1); /* exact size: reads beyond are seen */

			memcpy(part, data, cut);
			assert_int_equal(lp_jpeg_read(reader, part, cut), -EBADMSG);
			free(part);
		}
		assert_int_equal(lp_jpeg_read(reader, data, size - 2), 0); /* only EOI is missing */
		free(data);
	}
	lp_jpeg_reader_destroy(reader);
}

/* Bits of a string of zeros and ones, stuffed, padded with ones, and the end of the picture. */
static unsigned long write_bits(const char *bits, uint8_t *out)
{
	unsigned long size = 0;

	for (unsigned int byte = 0, n = 0; n % 8 || *bits; n++) {
		byte = byte << 1 | (*bits ? *bits++ == '1' : 1);
		if (n % 8 < 7)
			continue;
		out[size++] = (uint8_t)byte;
		if ((byte & 255) == 255)
			out[size++] = 0;
	}
	out[size++] = 0xff;
	out[size++] = 0xd9;
	return size;
}

/* A block of more than 63 AC coefficients is refused, be it the last one: where the walk is over,
 * whatever it came upon. */
static void test_overfull_block(void **state)
{
	/* DC 0; 62 coefficients +1; then that one, or one behind a run of 2; the block's end */
	const char *const last[] = {"001", "111001"};
	const int expected[] = {0, -EBADMSG};
	const struct jpeg_kind kind = {1, 1, 1, 85, 0, 0, 0};
	struct lp_jpeg_reader *reader;

	(void)state;
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (int k = 0; k < 2; k++) {
		char bits[256] = "00";
		unsigned long size;
		uint8_t *data = encode_jpeg(&kind, 8, 8, &size), *broken = malloc(size + 64);
		unsigned long scan = 0;

		for (int n = 0; n < 62; n++)
			strcat(bits, "001");
		strcat(bits, last[k]);
		if (k)
			strcat(bits, "1010");
		while (data[scan] != 0xff || data[scan + 1] != 0xda)
			scan++;
		scan += 2 + (data[scan + 2] << 8 | data[scan + 3]);
		memcpy(broken, data, scan);
		assert_int_equal(lp_jpeg_read(reader, broken,
					      scan + write_bits(bits, broken + scan)),
				 expected[k]);
		free(broken);
		free(data);
	}
	lp_jpeg_reader_destroy(reader);
}

/* Any damage: an answer, never a crash; a frame that passes holds blocks that can be decoded. */
static void test_damage(void **state)
{
	struct lp_jpeg_reader *reader;

	(void)state;
	srand(11);
	assert_int_equal(lp_jpeg_reader_create(&reader), 0);
	for (unsigned int k = 0; k < LP_COUNT(kinds); k++) {
		unsigned long size;
		uint8_t *data = encode_jpeg(&kinds[k], 96, 64, &size);

		for (int n = 0; n < 1500; n++) {
			uint8_t *damaged = malloc(size);

			memcpy(damaged, data, size);
			for (int j = 0; j < 1 + n % 4; j++)
				damaged[n % 2 ? (unsigned long)rand() % size
					      : (unsigned long)rand() % 700 % size] =
					(uint8_t)rand();
			if (lp_jpeg_read(reader, damaged, size) == 0) {
				uint8_t rgb[64][3];

				lp_jpeg_block_rgb(reader, lp_jpeg_visible_blocks_x(reader, 0) - 1,
						  lp_jpeg_visible_blocks_y(reader, 0) - 1, rgb);
			}
			free(damaged);
		}
		free(data);
	}
	lp_jpeg_reader_destroy(reader);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_dc_is_libjpegs),
		cmocka_unit_test(test_energy),
		cmocka_unit_test(test_stretches_do_not_matter),
		cmocka_unit_test(test_block_pixels),
		cmocka_unit_test(test_motion_jpeg_without_tables),
		cmocka_unit_test(test_other_jpegs_are_left_to_libjpeg),
		cmocka_unit_test(test_truncation),
		cmocka_unit_test(test_overfull_block),
		cmocka_unit_test(test_damage),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
