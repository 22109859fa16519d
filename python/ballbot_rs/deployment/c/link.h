/* ---- Bytes. Numbers are little-endian whatever the processor is; doubles have 64 bits, checked here. */
typedef char ballbot_link_needs_doubles_of_64_bits[sizeof(double) == 8 ? 1 : -1];

static inline void ballbot_link_put(uint8_t **to, uint64_t value, int size)
{
    int i;
    for (i = 0; i < size; i++) {
        *(*to)++ = (uint8_t)(value >> (8 * i));
    }
}

static inline uint64_t ballbot_link_get(const uint8_t **from, int size)
{
    uint64_t value = 0;
    int i;
    for (i = 0; i < size; i++) {
        value |= (uint64_t)*(*from)++ << (8 * i);
    }
    return value;
}

static inline void ballbot_link_put_doubles(uint8_t **to, const double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, values + i, sizeof bits);
        ballbot_link_put(to, bits, 8);
    }
}

static inline void ballbot_link_get_doubles(const uint8_t **from, double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        const uint64_t bits = ballbot_link_get(from, 8);
        memcpy(values + i, &bits, sizeof bits);
    }
}

/* CRC-32 of IEEE 802.3, without a table. */
static inline uint32_t ballbot_link_crc(const uint8_t *bytes, int size)
{
    uint32_t crc = 0xFFFFFFFFu;
    int i, bit;
    for (i = 0; i < size; i++) {
        crc ^= bytes[i];
        for (bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (crc & 1u ? 0xEDB88320u : 0u);
        }
    }
    return ~crc;
}

/* Ends a frame that begins at frame + 1 and fills up to `to`: the checksum, COBS in place, and the zero. Its bytes. */
static inline int ballbot_link_finish(uint8_t *frame, uint8_t *to)
{
    int code = 0;
    int size, i;
    ballbot_link_put(&to, ballbot_link_crc(frame + 1, (int)(to - frame) - 1), 4);
    size = (int)(to - frame);
    /* Each zero, and the byte before the frame, becomes the distance to the next; frames are shorter than 255 bytes. */
    for (i = 1; i < size; i++) {
        if (frame[i] == 0) {
            frame[code] = (uint8_t)(i - code);
            code = i;
        }
    }
    frame[code] = (uint8_t)(size - code);
    frame[size] = 0;
    return size + 1;
}

/* ---- Decoder of a stream of bytes. */

/* Set it to zero, `ballbot_link_decoder decoder = {0};`. The start of the stream counts as the end of a frame. */
typedef struct {
    uint8_t bytes[BALLBOT_LINK_LONGEST]; /* of the frame so far; once it is complete, header, payload and checksum */
    int size;                            /* bytes of the frame so far, beyond BALLBOT_LINK_LONGEST if it is too long */
    uint32_t frames;                     /* complete frames */
    uint32_t broken;                     /* frames of a wrong length or COBS code, or too long */
    uint32_t corrupted;                  /* frames with a wrong checksum */
    uint32_t unknown;                    /* frames of another version or kind */
} ballbot_link_decoder;

/* Undoes COBS in place; the bytes that remain, 0 if a code is wrong. */
static inline int ballbot_link_unstuff(uint8_t *bytes, int size)
{
    int code = 0;
    int i;
    while (code < size) {
        const int next = code + bytes[code];
        if (bytes[code] == 0xFF || next > size) {
            return 0;
        }
        bytes[code] = 0;
        code = next;
    }
    for (i = 1; i < size; i++) {
        bytes[i - 1] = bytes[i];
    }
    return size - 1;
}

/* Takes the next byte of the stream. Its kind if it ends a frame that is whole, else 0; `ballbot_link_decode_readings`
 * and `ballbot_link_decode_torques` read the frame before the next byte. */
static inline int ballbot_link_feed(ballbot_link_decoder *decoder, uint8_t byte)
{
    const uint8_t *checksum;
    int size = decoder->size;
    if (byte != 0) {
        if (size < BALLBOT_LINK_LONGEST) {
            decoder->bytes[size] = byte;
        }
        decoder->size = size < BALLBOT_LINK_LONGEST ? size + 1 : size;
        return 0;
    }
    decoder->size = 0;
    if (size == 0) {
        return 0;
    }
    size = size < BALLBOT_LINK_LONGEST ? ballbot_link_unstuff(decoder->bytes, size) : 0;
    if (size < BALLBOT_LINK_HEADER + 4) {
        decoder->broken++;
        return 0;
    }
    checksum = decoder->bytes + size - 4;
    if (ballbot_link_get(&checksum, 4) != ballbot_link_crc(decoder->bytes, size - 4)) {
        decoder->corrupted++;
        return 0;
    }
    if (decoder->bytes[0] != BALLBOT_LINK_VERSION || size != ballbot_link_size(decoder->bytes[1])) {
        decoder->unknown++;
        return 0;
    }
    decoder->frames++;
    return decoder->bytes[1];
}
