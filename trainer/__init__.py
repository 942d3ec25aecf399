"""The offline trainer: networks, algorithms, evaluation, export and reports."""
