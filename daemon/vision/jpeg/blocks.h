/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Light in the compressed domain: read a baseline JPEG only as far as its blocks' means (DC) and
 * the energy of their detail (AC, by Parseval), without inverse transform and without
 * reconstructing a picture. Single blocks can be decoded afterwards (vision/jpeg/pixels.h uses the
 * positions kept here).
 *
 * Reads: 8-bit baseline and extended sequential, one interleaved scan, grey or YCbCr with any of
 * 4:4:4, 4:2:2, 4:4:0, 4:2:0, restart intervals, Motion JPEG without DHT. Any other JPEG: -ENOTSUP,
 * and libjpeg-turbo reads it. Anything broken: -EBADMSG, never a read outside the data. A picture
 * is whole when every MCU is found, between restart markers that are in turn. A few bytes too many
 * before a marker, and an end without EOI, are no damage.
 */
#ifndef LP_VISION_JPEG_BLOCKS_H
#define LP_VISION_JPEG_BLOCKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "vision/jpeg/huffman.h"
#include "vision/jpeg/walk.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LP_JPEG_MAX_SIDE_PX 16384
/* Blocks of storage beyond the last: vector loads and stores may touch them. */
#define LP_JPEG_BLOCK_MARGIN 8

/* One colour component at block resolution. Mean sample = 128 + dc * dc_step / 8. */
struct lp_jpeg_component {
	int id;
	int h, v;		/* sampling factors, 1 or 2 */
	int blocks_x, blocks_y; /* stored, padded to whole MCUs */
	int dc_step;		/* quantiser of DC */
	int16_t *dc;		/* quantised, row-major */
	/* lp_jpeg_read_quarters(): mean sample of each quarter of a block (4 x 4 samples), in
	 * eighths, less 128; 2 blocks_x to a row */
	int16_t *quarters;
	size_t quarter_capacity;
	int quant_table, dc_table, ac_table;
};

/* Everything one frame needs; storage grows to the largest frame seen and stays. One thread. */
struct lp_jpeg_reader {
	int width_px, height_px;
	int component_count; /* 1 or 3 */
	struct lp_jpeg_component component[3];
	int mcus_x, mcus_y;
	int restart_interval; /* in MCUs; 0: none */

	/* Luma detail: sum of squared dequantised AC coefficients, in LP_ENERGY_STEPS; variance of
	 * the samples = this / LP_ENERGY_STEPS / 64. */
	int32_t *energy;

	uint16_t quant[4][64]; /* in zigzag order */
	bool quant_defined[4];
	struct lp_huffman_dc dc_table[2];
	struct lp_huffman_ac ac_table[2];
	struct lp_probes head[2][2]; /* of blocks, by DC and AC table */
	bool head_built[2][2];
	uint8_t dht[2048]; /* the DHT bytes that the tables were built from, to build them once */
	size_t dht_size;
	bool dht_standard;   /* tables are the standard ones: the frame had no DHT */
	int adobe_transform; /* of APP14; -1: none */

	/* Entropy-coded data without stuffing; segments begin at restart markers. */
	uint8_t *stream;
	size_t stream_capacity, stream_size;
	uint32_t *segment_start; /* byte offsets into stream, segment_count + 1 of them */
	int segment_count, segment_capacity;
	bool goes_on;	   /* other markers than EOI follow: another scan may */
	uint32_t *mcu_bit; /* bit offset into stream where each MCU begins */
	size_t block_capacity[3], mcu_capacity;
	uint32_t prediction[3]; /* of DC: running, within a restart segment */
	struct lp_jpeg_path path;
	struct lp_jpeg_mark *marks; /* of the blocks of two walks */
	size_t mark_capacity;
};

int lp_jpeg_reader_create(struct lp_jpeg_reader **reader);
void lp_jpeg_reader_destroy(struct lp_jpeg_reader *reader); /* accepts NULL */

/* Reads headers, DC of every component and the luma energy. After an error the reader holds no
 * frame (width_px = 0) and may be used again. -EBADMSG, -ENOTSUP, -ENOMEM. */
int lp_jpeg_read(struct lp_jpeg_reader *reader, const uint8_t *data, size_t size_bytes);

/* Fill the quarters of every component of the frame last read: its coefficients are decoded, but
 * not transformed. -ENOMEM. */
int lp_jpeg_read_quarters(struct lp_jpeg_reader *reader);

/* Blocks of component `c` that lie inside the picture (the others are padding to whole MCUs). */
int lp_jpeg_visible_blocks_x(const struct lp_jpeg_reader *reader, int c);
int lp_jpeg_visible_blocks_y(const struct lp_jpeg_reader *reader, int c);

/* A luma block and the chroma of its MCU: dequantised coefficients in natural (row-major) order. */
struct lp_jpeg_mcu_block {
	int16_t luma[64], cb[64], cr[64];
};

/* Decode luma block (bx, by) of the frame last read; chroma is left alone in grey pictures. */
void lp_jpeg_block_coefficients(const struct lp_jpeg_reader *reader, int bx, int by,
				struct lp_jpeg_mcu_block *block);

/* internal to the reader: room for `count` elements; contents are not kept. -ENOMEM. */
int lp_jpeg_reserve(void *storage, size_t *capacity, size_t count, size_t element_bytes);

/* internal to the reader: headers up to and including SOS. Returns the offset of the entropy data.
 */
long lp_jpeg_parse_headers(struct lp_jpeg_reader *reader, const uint8_t *data, size_t size_bytes);

#ifdef __cplusplus
}
#endif

#endif
