/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Huffman tables of baseline JPEG (ITU-T T.81, annexes C, F and K), prepared for walking blocks
 * without decoding them: one probe of 12 bits may pass several AC symbols at once.
 */
#ifndef LP_VISION_JPEG_HUFFMAN_H
#define LP_VISION_JPEG_HUFFMAN_H

#include <assert.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define LP_PROBE_BITS 12
#define LP_PROBES (1 << LP_PROBE_BITS)
#define LP_PROBE_MAX_BITS 18	/* that one passes: value bits may reach beyond the probe */
#define LP_DC_UNKNOWN INT16_MIN /* code and value are longer than a probe */

/*
 * A skip is how far a probe of AC data, or of a block's head, goes: the bits consumed (codes and
 * value bits) in the six lowest bits, and LP_SKIP_END when the block ends.
 */
#define LP_SKIP_END 0x80

/*
 * What it passes there: in the six lowest bits the offset of the largest value; from
 * LP_PASSED_COEFFICIENT on the number of coefficients, or LP_PASSED_NONE for no whole symbol; from
 * LP_PASSED_ENERGY on the sum of the squared quantised values, expected where the last one's bits
 * reach beyond the probe, in quarters.
 */
#define LP_PASSED_COEFFICIENT 6
#define LP_PASSED_NONE (64 << LP_PASSED_COEFFICIENT)
#define LP_PASSED_ENERGY 13
#define LP_PASSED_MAX_SIZE 8 /* of a value, in bits: so that the energy has room */
#define LP_ENERGY_STEPS 4

struct lp_huffman {
	bool defined;
	/* canonical code: values of length l have codes first_code[l]..first_code[l] + count[l] - 1
	 */
	uint8_t count[17];
	uint8_t value[256];
	uint32_t first_code[18];
	int first_value[17];
	uint8_t length_at[LP_PROBES]; /* code length that a probe begins with; 0: longer than the
					 probe */
	uint8_t symbol_at[LP_PROBES];
};

struct lp_huffman_dc {
	struct lp_huffman code;
	int16_t difference[LP_PROBES]; /* or LP_DC_UNKNOWN */
};

/* In two tables: where the next probe begins waits for the first one, which is small enough to stay
 * in the processor's nearest cache; the second can come late. */
struct lp_probes {
	uint8_t skip[LP_PROBES];
	uint32_t passed[LP_PROBES];
};

struct lp_huffman_ac {
	struct lp_huffman code;
	struct lp_probes probes;
};

/* counts[1..16] and values as in a DHT segment. -EBADMSG: not a prefix code, or (DC) a category
 * > 15. */
int lp_huffman_dc_build(struct lp_huffman_dc *table, const uint8_t counts[16],
			const uint8_t *values);
int lp_huffman_ac_build(struct lp_huffman_ac *table, const uint8_t counts[16],
			const uint8_t *values);

/* The tables of T.81 K.3, which Motion JPEG leaves out. chroma: 0 or 1. */
void lp_huffman_dc_standard(struct lp_huffman_dc *table, int chroma);
void lp_huffman_ac_standard(struct lp_huffman_ac *table, int chroma);

/* Probes at the heads of blocks that are coded with this pair of tables: DC, which has no energy,
 * and what follows. */
void lp_huffman_heads(const struct lp_huffman *dc, const struct lp_huffman *ac,
		      struct lp_probes *heads);

/* internal: lp_huffman_symbol() where the code is longer than a probe */
int lp_huffman_long_symbol(const struct lp_huffman *code, uint32_t window, int *length);

/* Symbol at the head of `window` (16 bits, left-aligned in the low 16); *length receives its code's
 * length. -1: no such code. */
static inline int lp_huffman_symbol(const struct lp_huffman *code, uint32_t window, int *length)
{
	const uint32_t probe = window >> (16 - LP_PROBE_BITS);

	*length = code->length_at[probe];
	return *length ? code->symbol_at[probe] : lp_huffman_long_symbol(code, window, length);
}

/* An AC symbol that ends its block; one without value bits that does not is sixteen zeros. */
static inline bool lp_jpeg_ends_block(int symbol)
{
	return (symbol & 15) == 0 && symbol >> 4 != 15;
}

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "a stream's words are swapped");

/* At least 57 bits of a stream from `bit` on, the first one highest. Reads 8 bytes. */
static inline uint64_t lp_jpeg_window(const uint8_t *stream, uint32_t bit)
{
	uint64_t word;

	memcpy(&word, stream + bit / 8, sizeof(word));
	return __builtin_bswap64(word) << bit % 8;
}

/* Value of `size` bits in JPEG's sign convention (T.81, F.2.2.1 EXTEND). */
static inline int lp_jpeg_extend(uint32_t bits, int size)
{
	return size && bits < (1U << (size - 1)) ? (int)bits - (1 << size) + 1 : (int)bits;
}

#endif
