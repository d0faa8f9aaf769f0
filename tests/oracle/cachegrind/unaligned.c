/* Random loads, stores and read-modify-writes of 1 to 16 bytes at any alignment in 64 KiB, many across two lines.
   gcc -O1 -static -nostdlib -ffreestanding -fno-stack-protector -o unaligned unaligned.c */
static unsigned char buf[(1 << 16) + 64] __attribute__((aligned(64)));
typedef unsigned long long u64 __attribute__((aligned(1)));
typedef unsigned u32 __attribute__((aligned(1)));
typedef unsigned short u16 __attribute__((aligned(1)));

__attribute__((force_align_arg_pointer)) void _start(void)
{
    unsigned s = 1;
    volatile unsigned long long sum = 0;
    for (int i = 0; i < 20000; i++) {
        s = s * 1664525u + 1013904223u;
        unsigned a = s >> 8 & 0xffff;
        switch (s >> 28 & 7) {
        case 0: sum += *(u64 *)(buf + a); break;
        case 1: *(u64 *)(buf + a) = sum; break;
        case 2: (*(u32 *)(buf + a))++; break;
        case 3: sum += *(u16 *)(buf + a); break;
        case 4: *(u32 *)(buf + a) = s; break;
        case 5: __asm__ volatile("movdqu %0, %%xmm0; movdqu %%xmm0, %1" : : "m"(buf[a]), "m"(buf[a ^ 0x500]) : "xmm0", "memory"); break;
        default: sum += buf[a];
        }
    }
    __asm__ volatile("mov $60, %eax; xor %edi, %edi; syscall");
}
