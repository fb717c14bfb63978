/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/jpeg/walk.h"

#include <assert.h>
#include <string.h>

/* Steps between two refills: none passes more bits than LP_PROBE_MAX_BITS. */
#define STEPS 3
#define HOT_INLINE static inline __attribute__((always_inline))
/* Hides from the compiler how a value came to be: it would make a branch of a mask, and which step
 * is a block's last is anything but predictable. */
#define OPAQUE(value) __asm__("" : "+r"(value))

static_assert(STEPS * LP_PROBE_MAX_BITS <= 56, "a full window holds 56 bits");

/* At least 56 bits afterwards. Reads 8 bytes at `next`. */
HOT_INLINE void refill(struct lp_jpeg_walk *w)
{
	const uint32_t count = w->next_bit - w->bit;
	const uint32_t bytes = (63 - count) >> 3;
	uint64_t word;

	memcpy(&word, w->next, sizeof(word));
	w->window |= __builtin_bswap64(word) >> count;
	w->next += bytes;
	w->next_bit += 8 * bytes;
}

HOT_INLINE void drop(struct lp_jpeg_walk *w, uint64_t bits)
{
	w->window <<= bits & 63;
	w->bit += bits & 63;
}

/* For the next step; `ends`: all ones when the block has, else 0. */
HOT_INLINE const struct lp_probes *probes_after(const struct lp_jpeg_slot *slot, intptr_t ends)
{
	return (const struct lp_probes *)((const char *)slot->inside + (slot->to_head & ends));
}

void lp_jpeg_walk_begin(struct lp_jpeg_walk *walk, const struct lp_jpeg_path *path, uint32_t bit,
			uint32_t limit_bit, struct lp_jpeg_mark *marks, size_t blocks)
{
	const struct lp_jpeg_slot *last = &path->slot[path->slots - 1];

	*walk = (struct lp_jpeg_walk){.next = path->stream + bit / 8,
				      .next_bit = bit & ~7U,
				      .bit = bit & ~7U,
				      .probes = probes_after(last, -1),
				      .slot = last->next[1],
				      .mark = marks,
				      .last = marks + blocks,
				      .limit_bit = limit_bit};
	refill(walk);
	drop(walk, bit % 8);
}

/* The steps that are left until the next refill go on, through nonsense. */
static void break_off(struct lp_jpeg_walk *w)
{
	if (!w->broken_at)
		w->broken_at = w->mark;
	w->limit_bit = 0;
}

/* One symbol that a probe does not pass, whole. */
static __attribute__((noinline, cold)) void step_slowly(struct lp_jpeg_walk *w,
							const struct lp_jpeg_path *path)
{
	const struct lp_jpeg_slot *slot = w->slot;
	uint32_t k = w->coefficient >> LP_PASSED_COEFFICIENT;
	bool ends = false;
	int length;

	refill(w);
	const int symbol = lp_huffman_symbol(k ? slot->ac_code : slot->dc_code,
					     (uint32_t)(w->window >> 48), &length);

	if (symbol < 0) {
		break_off(w);
		return;
	}
	const int size = symbol & 15;
	const uint32_t bits = size ? (uint32_t)(w->window << length >> (64 - size)) : 0;

	if (!k) {
		k = 1;
	} else if (lp_jpeg_ends_block(symbol)) {
		ends = true;
	} else {
		const int64_t value = lp_jpeg_extend(bits, size);

		k += (uint32_t)(symbol >> 4) + 1;
		if (k > 64) {
			break_off(w);
			return;
		}
		w->energy += (uint32_t)(value * value * LP_ENERGY_STEPS * path->weight[k - 1]);
		ends = k == 64;
	}
	drop(w, (uint32_t)(length + size));
	refill(w);
	*w->mark = (struct lp_jpeg_mark){w->bit, w->energy};
	w->coefficient = ends ? 0 : k << LP_PASSED_COEFFICIENT;
	w->probes = probes_after(slot, -(intptr_t)ends);
	w->slot = slot->next[ends];
	w->mark += ends;
}

/*
 * One probe, and the change to the next block if it ends this one: without a branch, but for what
 * is rare. The mark is written at every step; the block's last one stays.
 */
HOT_INLINE void step(struct lp_jpeg_walk *w, const struct lp_jpeg_path *path)
{
	const struct lp_jpeg_slot *slot = w->slot;
	const uint32_t probe = (uint32_t)(w->window >> (64 - LP_PROBE_BITS));
	const uint32_t skip = w->probes->skip[probe];
	const uint32_t passed = w->probes->passed[probe];
	const uint32_t k = w->coefficient;
	const uint32_t after = k + (passed & (127 << LP_PASSED_COEFFICIENT));

	if (__builtin_expect(after & LP_PASSED_NONE, 0)) { /* none, or beyond the block */
		struct lp_jpeg_walk copy =
			*w; /* its address must not be taken: see lp_jpeg_walk_on() */

		step_slowly(&copy, path);
		*w = copy;
		return;
	}
	const uint32_t strongest =
		(k >> LP_PASSED_COEFFICIENT) + (passed & ((1 << LP_PASSED_COEFFICIENT) - 1));
	int64_t ends = (int8_t)skip >> 7;

	OPAQUE(ends);
	w->energy += (passed >> LP_PASSED_ENERGY) * path->weight[strongest];
	drop(w, skip);
	*w->mark = (struct lp_jpeg_mark){w->bit, w->energy};
	w->mark = (struct lp_jpeg_mark *)((char *)w->mark + (ends & (int)sizeof(*w->mark)));
	w->coefficient = after & ~(uint32_t)ends;
	w->probes = probes_after(slot, ends);
	w->slot = *(const struct lp_jpeg_slot *const *)((const char *)slot->next +
							(ends & (int)sizeof(uintptr_t)));
}

/* The walks live in locals whose address is never taken: were they in memory, every step would wait
 * for it. */
void lp_jpeg_walk_on(struct lp_jpeg_walk *walk, const struct lp_jpeg_path *path)
{
	struct lp_jpeg_walk w = *walk;

	while (!lp_jpeg_walk_ended(&w)) {
		refill(&w);
		step(&w, path);
		step(&w, path);
		step(&w, path);
	}
	*walk = w;
}

void lp_jpeg_walk_both(struct lp_jpeg_walk *one, struct lp_jpeg_walk *other,
		       const struct lp_jpeg_path *path)
{
	struct lp_jpeg_walk a = *one, b = *other;

	while (!lp_jpeg_walk_ended(&a) && !lp_jpeg_walk_ended(&b)) {
		refill(&a);
		refill(&b);
		step(&a, path);
		step(&b, path);
		step(&a, path);
		step(&b, path);
		step(&a, path);
		step(&b, path);
	}
	*one = a;
	*other = b;
}
