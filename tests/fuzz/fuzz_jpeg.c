/* SPDX-License-Identifier: Apache-2.0 */
/* The block reader: never a wild read, and where libjpeg-turbo finds nothing to complain about, the
 * same DC bit for bit. One reader for all inputs, as the daemon has one for all frames. */
#include "fuzz.h"

#include <setjmp.h>
#include <stdio.h>

#include <jpeglib.h>

#include "vision/jpeg/blocks.h"
#include "vision/jpeg/pixels.h"

#define MOST_PIXELS ((size_t)1 << 18) /* libjpeg-turbo keeps all coefficients */
#define MOST_BLOCKS 256		      /* decoded to pixels */

struct referee {
	struct jpeg_decompress_struct info; /* first: messages() and give_up() get its address */
	struct jpeg_error_mgr errors;
	jmp_buf end;
	long complaints;
};

static void give_up(j_common_ptr info)
{
	longjmp(((struct referee *)info)->end, 1);
}

static void count_complaint(j_common_ptr info, int level)
{
	if (level < 0)
		((struct referee *)info)->complaints++;
}

static void compare_component(struct referee *r, jvirt_barray_ptr array, int k,
			      const struct lp_jpeg_reader *reader)
{
	const jpeg_component_info *theirs = &r->info.comp_info[k];
	const struct lp_jpeg_component *ours = &reader->component[k];

	for (JDIMENSION y = 0; y < theirs->height_in_blocks; y++) {
		const JBLOCKARRAY row =
			r->info.mem->access_virt_barray((j_common_ptr)&r->info, array, y, 1, FALSE);

		for (JDIMENSION x = 0; x < theirs->width_in_blocks; x++)
			fuzz_assert(ours->dc[(size_t)y * ours->blocks_x + x] == row[0][x][0]);
	}
}

static void compare(const struct lp_jpeg_reader *reader, const uint8_t *data, size_t size)
{
	struct referee r = {.complaints = 0};

	r.info.err = jpeg_std_error(&r.errors);
	r.errors.error_exit = give_up;
	r.errors.emit_message = count_complaint;
	if (setjmp(r.end) == 0) {
		jpeg_create_decompress(&r.info);
		jpeg_mem_src(&r.info, data, size);
		jpeg_read_header(&r.info, TRUE);
		jvirt_barray_ptr *arrays = jpeg_read_coefficients(&r.info);

		/* a later scan may redefine what the first one said, which is all we read */
		if (!r.complaints && r.info.input_scan_number == 1 &&
		    r.info.num_components == reader->component_count)
			for (int k = 0; k < reader->component_count; k++)
				compare_component(&r, arrays[k], k, reader);
	}
	jpeg_destroy_decompress(&r.info);
}

static void decode_blocks(const struct lp_jpeg_reader *reader)
{
	const int columns = lp_jpeg_visible_blocks_x(reader, 0);
	const int rows = lp_jpeg_visible_blocks_y(reader, 0);
	uint8_t rgb[64][3];

	for (int i = 0; i < columns * rows && i < MOST_BLOCKS; i++)
		lp_jpeg_block_rgb(reader, i % columns, i / columns, rgb);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct lp_jpeg_reader *reader;

	if (!reader)
		fuzz_assert(lp_jpeg_reader_create(&reader) == 0);
	if (lp_jpeg_read(reader, data, size) < 0) {
		fuzz_assert(reader->width_px == 0 && reader->height_px == 0);
		return 0;
	}
	decode_blocks(reader);
	if ((size_t)reader->width_px * reader->height_px <= MOST_PIXELS)
		compare(reader, data, size);
	return 0;
}
