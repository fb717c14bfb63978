// SPDX-License-Identifier: Apache-2.0
using System;

namespace Lightprobe
{
    /// <summary>Messages to and from a probe, whole. One thread receives, one at a time sends; Dispose ends both.</summary>
    internal abstract class Connection : IDisposable
    {
        /// <summary>No probe sends a longer message. The largest, a reflection map, has 98 432 bytes (docs/users/clients.md).</summary>
        internal const int MostBytes = 131072;

        internal abstract void Send(byte[] message);

        /// <summary>Waits for the next message; null: the probe has closed the connection.</summary>
        /// <param name="timeoutMs">How long; System.Threading.Timeout.Infinite: for ever.</param>
        /// <exception cref="TimeoutException">Nothing came.</exception>
        /// <exception cref="WireException">What came is no message.</exception>
        internal abstract byte[] Receive(int timeoutMs);

        public abstract void Dispose();
    }
}
