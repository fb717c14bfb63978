/* SPDX-License-Identifier: Apache-2.0 */
/* Shared by the files of this board. */
#ifndef WAKE_H
#define WAKE_H

#include <stdbool.h>

/* Set by interrupts that give the main loop something to do. */
extern volatile bool wake;

/* By the newest reading; kept over a reset, to judge its cause by. */
extern volatile bool supply_was_low;

void board_uart_start(bool on);
enum carrier board_strap(void);

#endif
