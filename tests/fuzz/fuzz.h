/* SPDX-License-Identifier: Apache-2.0 */
/* One fuzz_NAME.c per target; seeds, and inputs that once found something, in corpus/NAME/. */
#ifndef LP_FUZZ_H
#define LP_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* What must hold whatever the input: libFuzzer reports the abort with the input that broke it. */
static inline void fuzz_assert(int holds)
{
	if (!holds)
		abort();
}

#endif
