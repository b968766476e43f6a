"""What is sent by itself: one table, its builders."""
