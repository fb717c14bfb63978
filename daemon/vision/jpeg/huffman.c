/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/jpeg/huffman.h"

#include <errno.h>
#include <math.h>
#include <string.h>

static int build_code(struct lp_huffman *code, const uint8_t counts[16], const uint8_t *values)
{
	uint32_t next = 0;
	int total = 0;

	code->defined = false;
	memset(code->length_at, 0, sizeof(code->length_at));
	for (int length = 1; length <= 16; length++) {
		const int n = counts[length - 1];

		code->count[length] = (uint8_t)n;
		code->first_code[length] = next;
		code->first_value[length] = total;
		if (total + n > 256 || next + n > (1U << length))
			return -EBADMSG;
		memcpy(code->value + total, values + total, n);
		for (int i = 0; i < n && length <= LP_PROBE_BITS; i++) {
			const int free_bits = LP_PROBE_BITS - length;
			const uint32_t from = (next + i) << free_bits;

			memset(code->length_at + from, length, (size_t)1 << free_bits);
			memset(code->symbol_at + from, values[total + i], (size_t)1 << free_bits);
		}
		total += n;
		next = (next + n) << 1;
	}
	code->defined = true;
	return 0;
}

int lp_huffman_long_symbol(const struct lp_huffman *code, uint32_t window, int *length)
{
	for (int l = LP_PROBE_BITS + 1; l <= 16; l++) {
		const uint32_t prefix = window >> (16 - l);

		if (prefix - code->first_code[l] < code->count[l]) {
			*length = l;
			return code->value[code->first_value[l] + (prefix - code->first_code[l])];
		}
	}
	return -1;
}

/* Bits of the DC difference, code and value, that a probe begins with; 0: more than `most`, or its
 * code is longer than the probe. */
static int dc_bits(const struct lp_huffman *code, uint32_t probe, int most)
{
	const int length = code->length_at[probe], bits = length + code->symbol_at[probe];

	return length && bits <= most ? bits : 0;
}

int lp_huffman_dc_build(struct lp_huffman_dc *table, const uint8_t counts[16],
			const uint8_t *values)
{
	struct lp_huffman *code = &table->code;
	int ret = build_code(code, counts, values);

	if (ret < 0)
		return ret;
	for (int k = 0, n = code->first_value[16] + code->count[16]; k < n; k++)
		if (code->value[k] > 15)
			return -EBADMSG;
	for (uint32_t p = 0; p < LP_PROBES; p++) {
		const int bits = dc_bits(code, p, LP_PROBE_BITS), size = code->symbol_at[p];

		table->difference[p] = LP_DC_UNKNOWN;
		if (bits)
			table->difference[p] = (int16_t)lp_jpeg_extend(p >> (LP_PROBE_BITS - bits) &
									       ((1U << size) - 1),
								       size);
	}
	return 0;
}

/* Sum of the squares 1 .. n. */
static double sum_squares(double n)
{
	return n * (n + 1.0) * (2.0 * n + 1.0) / 6.0;
}

/*
 * Mean square of a value of `size` bits of which only the first `known` are (in `bits`), the others
 * being equally likely: exact when all are known.
 */
static float mean_square(uint32_t bits, int known, int size)
{
	const int open = size - known;
	double low, high; /* magnitudes that remain possible */

	if (!known) { /* not even the sign: it does not matter */
		low = 1 << (size - 1);
		high = (1 << size) - 1;
	} else {
		const int first = lp_jpeg_extend(bits << open, size);
		const int last = lp_jpeg_extend((bits << open) | ((1U << open) - 1), size);

		low = first > 0 ? first : -last;
		high = first > 0 ? last : -first;
	}
	return (float)((sum_squares(high) - sum_squares(low - 1.0)) / (high - low + 1.0));
}

/* What a probe passes. */
struct passed {
	int bits, coefficients;
	bool ends;
	float energy, largest;
	int strongest; /* offset of the largest */
};

static void add_energy(struct passed *passed, float square, int offset)
{
	if (square > passed->largest) {
		passed->largest = square;
		passed->strongest = offset;
	}
	passed->energy += square;
}

/* Pass as many AC symbols as begin and have their whole code inside the 12 bits of `p`. */
static void pass_symbols(const struct lp_huffman *code, uint32_t p, struct passed *passed)
{
	while (passed->bits < LP_PROBE_BITS && !passed->ends) {
		const uint32_t rest = p << passed->bits & (LP_PROBES - 1);
		const int length = code->length_at[rest];
		const int run = code->symbol_at[rest] >> 4, size = code->symbol_at[rest] & 15;
		const int inside = LP_PROBE_BITS - passed->bits - length;

		if (!length || inside < 0)
			return;
		if (lp_jpeg_ends_block(code->symbol_at[rest])) {
			passed->bits += length;
			passed->ends = true;
			return;
		}
		/* size 0 here: sixteen zeros. A block never holds more than 63 coefficients. */
		if (passed->coefficients + run + 1 > 63 || size > LP_PASSED_MAX_SIZE ||
		    passed->bits + length + size > LP_PROBE_MAX_BITS)
			return;
		if (size) {
			const int known = size < inside ? size : inside;
			const uint32_t bits = rest >> (LP_PROBE_BITS - length - known);

			add_energy(passed, mean_square(bits & ((1U << known) - 1), known, size),
				   passed->coefficients + run);
		}
		passed->bits += length + size;
		passed->coefficients += run + 1;
	}
}

static void fill_probe(struct lp_probes *probes, uint32_t p, const struct passed *passed)
{
	const uint32_t energy = (uint32_t)lrintf(passed->energy * LP_ENERGY_STEPS);
	const uint32_t coefficients = (uint32_t)passed->coefficients;

	probes->skip[p] = (uint8_t)(passed->bits | (passed->ends ? LP_SKIP_END : 0));
	probes->passed[p] = passed->bits ? energy << LP_PASSED_ENERGY |
						   coefficients << LP_PASSED_COEFFICIENT |
						   (uint32_t)passed->strongest
					 : LP_PASSED_NONE;
}

int lp_huffman_ac_build(struct lp_huffman_ac *table, const uint8_t counts[16],
			const uint8_t *values)
{
	int ret = build_code(&table->code, counts, values);

	if (ret < 0)
		return ret;
	for (uint32_t p = 0; p < LP_PROBES; p++) {
		struct passed passed = {0};

		pass_symbols(&table->code, p, &passed);
		fill_probe(&table->probes, p, &passed);
	}
	return 0;
}

void lp_huffman_heads(const struct lp_huffman *dc, const struct lp_huffman *ac,
		      struct lp_probes *heads)
{
	for (uint32_t p = 0; p < LP_PROBES; p++) {
		struct passed passed = {.bits = dc_bits(dc, p, LP_PROBE_MAX_BITS),
					.coefficients = 1};

		if (passed.bits)
			pass_symbols(ac, p, &passed);
		fill_probe(heads, p, &passed);
	}
}

/* T.81, tables K.3 to K.6. */
static const uint8_t dc_counts[2][16] = {
	{0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0},
	{0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0},
};
static const uint8_t dc_values[12] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
static const uint8_t ac_counts[2][16] = {
	{0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 125},
	{0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 119},
};
static const uint8_t ac_values[2][162] = {
	{0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61,
	 0x07, 0x22, 0x71, 0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52,
	 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72, 0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25,
	 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45,
	 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64,
	 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
	 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99,
	 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6,
	 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3,
	 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8,
	 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa},
	{0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61,
	 0x71, 0x13, 0x22, 0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33,
	 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1, 0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18,
	 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44,
	 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63,
	 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
	 0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97,
	 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4,
	 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca,
	 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7,
	 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa},
};

void lp_huffman_dc_standard(struct lp_huffman_dc *table, int chroma)
{
	lp_huffman_dc_build(table, dc_counts[chroma], dc_values);
}

void lp_huffman_ac_standard(struct lp_huffman_ac *table, int chroma)
{
	lp_huffman_ac_build(table, ac_counts[chroma], ac_values[chroma]);
}
