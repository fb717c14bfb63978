// SPDX-License-Identifier: Apache-2.0
using System;
using System.IO;
using System.Net.Sockets;

namespace Lightprobe
{
    /// <summary>tcp: each message has its length before it, as a varint.</summary>
    internal sealed class TcpConnection : Connection
    {
        private readonly TcpClient _client;
        private readonly NetworkStream _stream;
        private readonly BufferedStream _read;

        internal TcpConnection(Address address, int timeoutMs)
        {
            _client = Connect(address, timeoutMs);
            _stream = _client.GetStream();
            _read = new BufferedStream(_stream, 1 << 16);
        }

        /// <summary>Its streams read and write with the same time limit.</summary>
        internal static TcpClient Connect(Address address, int timeoutMs)
        {
            var client = new TcpClient { NoDelay = true, SendTimeout = timeoutMs, ReceiveTimeout = timeoutMs };
            try
            {
                IAsyncResult attempt = client.BeginConnect(address.Host, address.Port, null, null);
                if (!attempt.AsyncWaitHandle.WaitOne(timeoutMs)) throw new IOException("no answer within " + timeoutMs / 1000 + " s");
                client.EndConnect(attempt);
                return client;
            }
            catch
            {
                client.Close();
                throw;
            }
        }

        internal override void Send(byte[] message)
        {
            byte[] data = Delimited(message);
            _stream.Write(data, 0, data.Length);
        }

        internal override byte[] Receive(int timeoutMs)
        {
            _stream.ReadTimeout = timeoutMs;
            try
            {
                return Read(_read);
            }
            catch (IOException error) when (IsSilence(error.InnerException as SocketException))
            {
                throw new TimeoutException();
            }
        }

        /// <summary>Mono calls the end of the time WouldBlock.</summary>
        private static bool IsSilence(SocketException error) =>
            error != null && (error.SocketErrorCode == SocketError.TimedOut || error.SocketErrorCode == SocketError.WouldBlock);

        public override void Dispose() => _client.Close();

        internal static byte[] Delimited(byte[] message)
        {
            var framed = new WireWriter();
            framed.Delimited(message);
            return framed.ToArray();
        }

        /// <summary>Reads the next message; null: the stream has ended.</summary>
        internal static byte[] Read(Stream stream)
        {
            int length = 0;
            for (int shift = 0; ; shift += 7)
            {
                int part = stream.ReadByte();
                if (part < 0) return null;
                if (shift > 21) throw new WireException("a length of more than four bytes");
                length |= (part & 127) << shift;
                if (part < 128) break;
            }
            if (length > MostBytes) throw new WireException("a message of " + length + " bytes");
            var data = new byte[length];
            for (int at = 0; at < length;)
            {
                int count = stream.Read(data, at, length - at);
                if (count == 0) return null;
                at += count;
            }
            return data;
        }
    }
}
