#ifndef MESSAGE_BUFFER_H
#define MESSAGE_BUFFER_H
typedef StreamBufferHandle_t MessageBufferHandle_t;
MessageBufferHandle_t xMessageBufferCreate(size_t length);
size_t xMessageBufferSend(MessageBufferHandle_t buffer, const void *data, size_t bytes, TickType_t ticks);
size_t xMessageBufferSendFromISR(MessageBufferHandle_t buffer, const void *data, size_t bytes, BaseType_t *woken);
size_t xMessageBufferReceive(MessageBufferHandle_t buffer, void *data, size_t bytes, TickType_t ticks);
#endif
