/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Huffman tables of baseline JPEG (ITU-T T.81, annexes C, F and K), prepared for walking blocks
 * without decoding them: one probe of 12 bits may pass several AC symbols at once.
 */
#ifndef LP_VISION_JPEG_HUFFMAN_H
#define LP_VISION_JPEG_HUFFMAN_H

#include <stdbool.h>
#include <stdint.h>

#define LP_PROBE_BITS 12
#define LP_PROBES (1 << LP_PROBE_BITS)
#define LP_PROBE_MAX_BITS 18 /* that one passes: value bits may reach beyond the probe */
#define LP_HEAD_BITS 10
#define LP_HEADS (1 << LP_HEAD_BITS)
#define LP_ADVANCE_END 128  /* added to `advance` when the probe ends the block (EOB) */
#define LP_ADVANCE_NONE 255 /* no whole symbol in the probe */

/*
 * What 12 bits of AC data hold: whole symbols, the last one's value bits possibly beyond the probe.
 * In two tables: where the next probe begins waits for the first one, which is small enough to stay
 * in the processor's nearest cache; the second can come late.
 *
 * A skip is the bits consumed (codes and value bits) and, in the upper byte, the coefficients
 * passed, plus LP_ADVANCE_END; or LP_ADVANCE_NONE.
 */
static inline int lp_skip_bits(uint32_t skip)
{
	return skip & 63; /* what a shift takes anyway */
}

static inline int lp_skip_advance(uint32_t skip)
{
	return (int)(skip >> 8);
}

/* `after`: coefficient + advance. The block ends there, and is not overfull. */
static inline bool lp_skip_ends(int after)
{
	return after >= LP_ADVANCE_END && after < LP_ADVANCE_END + 64;
}

/* Sum of the squared quantised values that a probe passes, expected where the last one overhangs;
 * and the offset of the largest, in the six lowest bits of the float. 0: no energy. */
static inline float lp_probe_energy(uint32_t energy)
{
	union {
		uint32_t bits;
		float value;
	} u = {energy};

	return u.value;
}

static inline int lp_probe_strongest(uint32_t energy)
{
	return energy & 63;
}

/* The head of a block: a DC difference with code and value within the probe, or bits = 0; and when
 * the block ends right after it, within the probe as well, the bits of it all, or 0. */
struct lp_dc_probe {
	int16_t difference;
	uint8_t bits;
	uint8_t block_bits;
};

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

struct lp_huffman_ac {
	struct lp_huffman code;
	uint16_t skip[LP_PROBES];
	uint32_t energy[LP_PROBES];
};

/* counts[1..16] and values as in a DHT segment. -EBADMSG: not a prefix code, or (DC) a category
 * > 15. */
int lp_huffman_dc_build(struct lp_huffman *table, const uint8_t counts[16], const uint8_t *values);
int lp_huffman_ac_build(struct lp_huffman_ac *table, const uint8_t counts[16],
			const uint8_t *values);

/* The tables of T.81 K.3, which Motion JPEG leaves out. chroma: 0 or 1. */
void lp_huffman_dc_standard(struct lp_huffman *table, int chroma);
void lp_huffman_ac_standard(struct lp_huffman_ac *table, int chroma);

/* Probes for the heads of blocks that are coded with this pair of tables. */
void lp_huffman_heads(const struct lp_huffman *dc, const struct lp_huffman *ac,
		      struct lp_dc_probe probe[LP_HEADS]);

/* Symbol at the head of `window` (16 bits, left-aligned in the low 16) by its code's length;
 * *length receives that. -1: no such code. For what a probe cannot resolve. */
int lp_huffman_slow(const struct lp_huffman *code, uint32_t window, int *length);

/* Value of `size` bits in JPEG's sign convention (T.81, F.2.2.1 EXTEND). */
static inline int lp_jpeg_extend(uint32_t bits, int size)
{
	return size && bits < (1U << (size - 1)) ? (int)bits - (1 << size) + 1 : (int)bits;
}

#endif
