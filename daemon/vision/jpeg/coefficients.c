/* SPDX-License-Identifier: Apache-2.0 */
/* Single blocks, decoded after all. The stream has been found sound by lp_jpeg_read(). */
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
