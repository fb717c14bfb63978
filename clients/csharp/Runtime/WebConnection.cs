// SPDX-License-Identifier: Apache-2.0
using System;
using System.IO;
using System.Net.Security;
using System.Net.Sockets;
using System.Net.WebSockets;
using System.Security.Authentication;
using System.Security.Cryptography;
using System.Security.Cryptography.X509Certificates;
using System.Text;
using System.Threading;
using System.Threading.Tasks;

namespace Lightprobe
{
    /// <summary>
    /// ws: and wss: each message is one binary frame. The certificate is looked at before the token is sent, so TLS and the
    /// greeting of HTTP (RFC 6455, section 4) are made here: mono's ClientWebSocket does not let its user look. What comes
    /// after them is the system's WebSocket.
    /// </summary>
    internal sealed class WebConnection : Connection
    {
        private const string Protocol = "lightprobe.v1";
        private const string AcceptKey = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";
        private const int MostHeaderBytes = 8192, MostReasonBytes = 200;

        private readonly TcpClient _client;
        private readonly WebSocket _socket;
        private readonly byte[] _part = new byte[1 << 16];
        private readonly int _timeoutMs;

        internal WebConnection(Address address, int timeoutMs)
        {
            _timeoutMs = timeoutMs;
            _client = TcpConnection.Connect(address, timeoutMs);
            try
            {
                Stream stream = address.Scheme == "wss" ? Encrypted(_client.GetStream(), address) : _client.GetStream();
                Greet(stream, address);
                _client.ReceiveTimeout = 0; // Receive has limits of its own
                _socket = WebSocket.CreateFromStream(stream, false, Protocol, Timeout.InfiniteTimeSpan);
            }
            catch
            {
                _client.Close();
                throw;
            }
        }

        internal override void Send(byte[] message) =>
            Finish(stop => _socket.SendAsync(new ArraySegment<byte>(message), WebSocketMessageType.Binary, true, stop), _timeoutMs);

        internal override byte[] Receive(int timeoutMs)
        {
            var message = new MemoryStream();
            for (; ; )
            {
                WebSocketReceiveResult part = null;
                Finish(async stop => part = await _socket.ReceiveAsync(new ArraySegment<byte>(_part), stop), timeoutMs);
                if (part.MessageType == WebSocketMessageType.Close) return null;
                if (part.MessageType == WebSocketMessageType.Text) throw new WireException("a text message");
                if (message.Length + part.Count > MostBytes) throw new WireException("a message of more than " + MostBytes + " bytes");
                message.Write(_part, 0, part.Count);
                if (part.EndOfMessage) return message.ToArray();
            }
        }

        public override void Dispose()
        {
            _socket.Abort();
            _client.Close();
        }

        // ------------------------------------------------------------ TLS

        private static Stream Encrypted(Stream stream, Address address)
        {
            var found = new byte[0];
            RemoteCertificateValidationCallback look = (sender, certificate, chain, errors) =>
            {
                using (var sha256 = SHA256.Create()) found = sha256.ComputeHash(certificate.GetRawCertData());
                return Same(found, address.Sha256);
            };
            var encrypted = new SslStream(stream, false, address.Sha256 == null ? null : look);
            try
            {
                encrypted.AuthenticateAsClient(address.Host, null, SslProtocols.Tls12, false);
                return encrypted;
            }
            catch (AuthenticationException error)
            {
                throw new IOException(found.Length == 0 || Same(found, address.Sha256) ? "TLS: " + error.GetBaseException().Message
                    : "the certificate is not the one of the address: is this your probe? Nothing was sent to it. "
                    + "After a new `lightprobe pair` take the new address");
            }
        }

        private static bool Same(byte[] one, byte[] other)
        {
            int differs = one.Length ^ other.Length;
            for (int i = 0; i < one.Length && i < other.Length; i++) differs |= one[i] ^ other[i];
            return differs == 0;
        }

        // ------------------------------------------------------------ the greeting

        private static void Greet(Stream stream, Address address)
        {
            var nonce = new byte[16];
            using (var random = RandomNumberGenerator.Create()) random.GetBytes(nonce);
            string key = Convert.ToBase64String(nonce), host = new Uri(address.ToString()).Authority;
            string protocols = address.Token == null ? Protocol : Protocol + ", token." + address.Token;
            byte[] request = Encoding.ASCII.GetBytes("GET / HTTP/1.1\r\nHost: " + host + "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                + "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + key + "\r\nSec-WebSocket-Protocol: " + protocols + "\r\n\r\n");
            stream.Write(request, 0, request.Length);
            stream.Flush();
            string[] lines = Header(stream).Split(new[] { "\r\n" }, StringSplitOptions.None);
            if (!lines[0].StartsWith("HTTP/1.1 101", StringComparison.Ordinal)) throw new IOException("refused: " + Refusal(stream, lines, address));
            string accept;
            using (var sha1 = SHA1.Create()) accept = Convert.ToBase64String(sha1.ComputeHash(Encoding.ASCII.GetBytes(key + AcceptKey)));
            if (!Array.Exists(lines, line => line.Equals("Sec-WebSocket-Accept: " + accept, StringComparison.OrdinalIgnoreCase)))
                throw new IOException("the answer is not that of a WebSocket");
        }

        /// <summary>The reason that the daemon gives, and how its owner lets clients in that call it so.</summary>
        private static string Refusal(Stream stream, string[] lines, Address address)
        {
            const string lengthIs = "content-length:";
            string length = Array.Find(lines, line => line.StartsWith(lengthIs, StringComparison.OrdinalIgnoreCase));
            int.TryParse((length ?? lengthIs).Substring(lengthIs.Length), out int left);
            var reason = new StringBuilder();
            for (int part; reason.Length < Math.Min(left, MostReasonBytes) && (part = stream.ReadByte()) >= 0;)
                reason.Append(part >= ' ' && part <= '~' ? (char)part : ' ');
            string text = reason.Length > 0 ? reason.ToString().Trim() : Short(lines[0]);
            if (!lines[0].StartsWith("HTTP/1.1 403", StringComparison.Ordinal)) return text;
            string origin = (address.Scheme == "wss" ? "https://" : "http://") + new Uri(address.ToString()).Authority;
            return text + ": start lightprobed with ?origins=" + origin + " at the end of its --publish=" + address.Scheme
                + ":…, or call it by its address";
        }

        /// <summary>The answer up to its empty line, byte by byte: what follows is the WebSocket's.</summary>
        private static string Header(Stream stream)
        {
            var header = new StringBuilder();
            while (header.Length < 4 || header.ToString(header.Length - 4, 4) != "\r\n\r\n")
            {
                int part = stream.ReadByte();
                if (part < 0) throw new IOException("the connection was closed instead of an answer");
                if (header.Length > MostHeaderBytes) throw new IOException("the answer is too long for HTTP");
                header.Append((char)part);
            }
            return header.ToString();
        }

        private static string Short(string line) => line.Length > 80 ? line.Substring(0, 80) : line;

        private static bool IsOver(Task work, int timeoutMs) => ((IAsyncResult)work).AsyncWaitHandle.WaitOne(timeoutMs);

        /// <summary>Waits for what is begun; its own exception, not one around it.</summary>
        private static void Finish(Func<CancellationToken, Task> begin, int timeoutMs)
        {
            using (var stop = new CancellationTokenSource())
                try
                {
                    // On a thread of the pool: where Unity's main thread waits, nothing may need it.
                    Task work = Task.Run(() => begin(stop.Token));
                    // After a pause of the app the time is over, and what came meanwhile is about to be read.
                    if (!IsOver(work, timeoutMs) && !IsOver(work, Drained.Turns * Drained.PeriodMs)) stop.Cancel();
                    work.GetAwaiter().GetResult();
                }
                catch (Exception) when (stop.IsCancellationRequested)
                {
                    throw new TimeoutException();
                }
        }
    }
}
