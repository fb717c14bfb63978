/* SPDX-License-Identifier: Apache-2.0 */
/* Blocks, decoded after all: single ones, and the quarters of all. The stream has been found sound
 * by lp_jpeg_read(). */
#include <math.h>
#include <string.h>

#include "vision/jpeg/blocks.h"

static const uint8_t natural_order[64] = {0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18,
					  11, 4,  5,  12, 19, 26, 33, 40, 48, 41, 34, 27, 20,
					  13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43,
					  36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45,
					  38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63};

/* The symbol at `*bit` and its value bits; passes them. -1: no code. */
static inline int read_symbol(const struct lp_jpeg_reader *reader, uint32_t *bit,
			      const struct lp_huffman *code, int *value)
{
	const uint64_t window = lp_jpeg_window(reader->stream, *bit);
	int length;

	const int symbol = lp_huffman_symbol(code, (uint32_t)(window >> 48), &length);
	const int size = symbol & 15;

	*value = 0;
	if (symbol < 0)
		return -1;
	if (size)
		*value = lp_jpeg_extend((uint32_t)(window << length >> (64 - size)), size);
	*bit += (uint32_t)(length + size);
	return symbol;
}

/* All coefficients of the block at `*bit`, whose DC is known; passes it. */
static void decode_block(const struct lp_jpeg_reader *reader, uint32_t *bit,
			 const struct lp_jpeg_component *c, int16_t dc, int16_t *coefficients)
{
	const struct lp_huffman *code = &reader->ac_table[c->ac_table].code;
	const uint16_t *quant = reader->quant[c->quant_table];
	int value;

	memset(coefficients, 0, 64 * sizeof(*coefficients));
	coefficients[0] = (int16_t)(dc * quant[0]);
	read_symbol(reader, bit, &reader->dc_table[c->dc_table].code, &value);
	for (int k = 1; k < 64; k++) {
		const int symbol = read_symbol(reader, bit, code, &value);

		if (symbol < 0 || lp_jpeg_ends_block(symbol))
			return;
		k += symbol >> 4;
		if (k > 63)
			return;
		coefficients[natural_order[k]] = (int16_t)(value * quant[k]);
	}
}

/* Passes the block at `*bit`, many symbols at a time. */
static void pass_block(const struct lp_jpeg_reader *reader, uint32_t *bit,
		       const struct lp_jpeg_component *c)
{
	const struct lp_probes *probes = &reader->head[c->dc_table][c->ac_table];
	const struct lp_huffman_ac *ac = &reader->ac_table[c->ac_table];
	int value;

	for (uint32_t k = 0; k < 64; probes = &ac->probes) {
		const uint64_t probe = lp_jpeg_window(reader->stream, *bit) >> (64 - LP_PROBE_BITS);
		const uint32_t passed = probes->passed[probe] >> LP_PASSED_COEFFICIENT & 127;

		if (k + passed < 64) {
			*bit += probes->skip[probe] & (LP_SKIP_END - 1);
			if (probes->skip[probe] & LP_SKIP_END)
				return;
			k += passed;
		} else if (!k) {
			read_symbol(reader, bit, &reader->dc_table[c->dc_table].code, &value);
			k = 1;
		} else {
			const int symbol = read_symbol(reader, bit, &ac->code, &value);

			if (symbol < 0 || lp_jpeg_ends_block(symbol))
				return;
			k += (uint32_t)(symbol >> 4) + 1;
		}
	}
}

void lp_jpeg_block_coefficients(const struct lp_jpeg_reader *reader, int bx, int by,
				struct lp_jpeg_mcu_block *block)
{
	const struct lp_jpeg_component *luma = &reader->component[0];
	const int mcu_x = bx / luma->h, mcu_y = by / luma->v;
	const int mcu = mcu_y * reader->mcus_x + mcu_x;
	const int wanted = by % luma->v * luma->h + bx % luma->h;
	uint32_t bit = reader->mcu_bit[mcu];
	int16_t *chroma[2] = {block->cb, block->cr};

	for (int k = 0; k < wanted; k++)
		pass_block(reader, &bit, luma);
	decode_block(reader, &bit, luma, luma->dc[(size_t)by * luma->blocks_x + bx], block->luma);
	for (int k = wanted + 1; k < luma->h * luma->v; k++)
		pass_block(reader, &bit, luma);
	for (int k = 1; k < reader->component_count && k <= 2; k++)
		decode_block(reader, &bit, &reader->component[k], reader->component[k].dc[mcu],
			     chroma[k - 1]);
}

/*
 * Quarters of blocks. The mean of half a cosine's period is 0 for even frequencies but the lowest,
 * and changes its sign from one half to the other for odd ones. So three sums of coefficients tell
 * how the halves differ: across, down, and crosswise.
 */

/* What coefficient k (zigzag order) adds to each sum, in eighths of a sample. */
struct quarter_weights {
	float across[64], down[64], crosswise[64];
};

/* Mean of C(u) / 2 cos((2 x + 1) u pi / 16) over the first half of a block (T.81, A.3.3). */
static float half_mean(int u)
{
	double sum = 0.0;

	for (int x = 0; x < 4; x++)
		sum += cos((2 * x + 1) * u * M_PI / 16.0) / 4.0;
	return (float)(u ? sum / 2.0 : M_SQRT1_2 / 2.0);
}

static void weigh(const uint16_t *quant, struct quarter_weights *weights)
{
	memset(weights, 0, sizeof(*weights));
	for (int k = 1; k < 64; k++) {
		const int u = natural_order[k] % 8, v = natural_order[k] / 8;
		const float share = 8.0F * (float)quant[k] * half_mean(u) * half_mean(v);

		if (u % 2 && !v)
			weights->across[k] = share;
		else if (v % 2 && !u)
			weights->down[k] = share;
		else if (u % 2 && v % 2)
			weights->crosswise[k] = share;
	}
}

/* The quarters of the block at `*bit`, whose DC is known; passes it. */
static void read_quarters(const struct lp_jpeg_reader *reader, uint32_t *bit,
			  const struct lp_jpeg_component *c, int bx, int by,
			  const struct quarter_weights *weights)
{
	const struct lp_huffman *code = &reader->ac_table[c->ac_table].code;
	const float mean = (float)(c->dc[(size_t)by * c->blocks_x + bx] * c->dc_step);
	int16_t *upper = c->quarters + ((size_t)by * 2 * c->blocks_x + bx) * 2;
	int16_t *lower = upper + (size_t)2 * c->blocks_x;
	float across = 0.0F, down = 0.0F, crosswise = 0.0F;
	int value;

	read_symbol(reader, bit, &reader->dc_table[c->dc_table].code, &value);
	for (int k = 1; k < 64; k++) {
		const int symbol = read_symbol(reader, bit, code, &value);

		if (symbol < 0 || lp_jpeg_ends_block(symbol))
			break;
		k += symbol >> 4;
		if (k > 63)
			break;
		across += (float)value * weights->across[k];
		down += (float)value * weights->down[k];
		crosswise += (float)value * weights->crosswise[k];
	}
	upper[0] = (int16_t)lrintf(mean + across + down + crosswise);
	upper[1] = (int16_t)lrintf(mean - across + down - crosswise);
	lower[0] = (int16_t)lrintf(mean + across - down - crosswise);
	lower[1] = (int16_t)lrintf(mean - across - down + crosswise);
}

int lp_jpeg_read_quarters(struct lp_jpeg_reader *reader)
{
	struct quarter_weights weights[3];

	for (int k = 0; k < reader->component_count; k++) {
		struct lp_jpeg_component *c = &reader->component[k];
		const size_t count = (size_t)4 * c->blocks_x * c->blocks_y;
		const int ret = lp_jpeg_reserve(&c->quarters, &c->quarter_capacity, count,
						sizeof(*c->quarters));

		if (ret < 0)
			return ret;
		weigh(reader->quant[c->quant_table], &weights[k]);
	}
	for (int mcu = 0; mcu < reader->mcus_x * reader->mcus_y; mcu++) {
		const int x = mcu % reader->mcus_x, y = mcu / reader->mcus_x;
		uint32_t bit = reader->mcu_bit[mcu];

		for (int k = 0; k < reader->component_count; k++) {
			const struct lp_jpeg_component *c = &reader->component[k];

			for (int b = 0; b < c->h * c->v; b++)
				read_quarters(reader, &bit, c, x * c->h + b % c->h,
					      y * c->v + b / c->h, &weights[k]);
		}
	}
	return 0;
}
