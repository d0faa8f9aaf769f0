"""The mecanum robot of source 1: its body, its controllers, and its software under FreeRTOS."""
